"""L.DKMGP: one deep-kernel GP for all reduced outputs (ICM), trained on the nearest simulations."""

from regional_lv.paper.emulators.local import LocalGP


class LocalDeepKernelMultiGP(LocalGP):
    """L.DKMGP of the paper.

    Settings: neighbours, kernel, iterations of a local fit, hidden (widths of the network).
    """

    name = "local_dkmgp"
    joint = True
