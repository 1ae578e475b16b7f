"""L.MGP: one GP for all reduced outputs (ICM), trained on the nearest simulations."""

from regional_lv.paper.emulators.local import LocalGP


class LocalMultiGP(LocalGP):
    """L.MGP of the paper. Settings: neighbours, kernel, iterations of a local fit."""

    name = "local_mgp"
    joint = True
