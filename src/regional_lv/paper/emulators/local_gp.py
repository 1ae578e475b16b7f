"""L.GP: one GP for each reduced output by itself, trained on the nearest simulations."""

from regional_lv.paper.emulators.local import LocalGP


class LocalSingleGP(LocalGP):
    """L.GP of the paper. Settings: neighbours, kernel, iterations of a local fit."""

    name = "local_gp"
    joint = False
