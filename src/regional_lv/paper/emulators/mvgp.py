"""MVGP: sparse variational GP for all reduced outputs, linear model of coregionalisation."""

from regional_lv.paper.emulators.variational import VariationalGP


class MVGP(VariationalGP):
    """MVGP of the paper. Settings: those of VGP, and latents (processes that are mixed)."""

    name = "mvgp"
    mixed = True
