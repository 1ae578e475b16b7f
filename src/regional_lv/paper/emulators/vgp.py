"""VGP: an independent sparse variational GP for each reduced output."""

from regional_lv.paper.emulators.variational import VariationalGP


class VGP(VariationalGP):
    """VGP of the paper. Settings: inducing, kernel, iterations, hyperparameter_rows."""

    name = "vgp"
    mixed = False
