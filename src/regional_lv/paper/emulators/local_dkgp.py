"""L.DKGP: a deep-kernel GP for each reduced output by itself, on the nearest simulations."""

from regional_lv.paper.emulators.local import LocalGP


class LocalDeepKernelGP(LocalGP):
    """L.DKGP of the paper.

    Settings: neighbours, kernel, iterations of a local fit, hidden (widths of the network).
    """

    name = "local_dkgp"
    joint = False
