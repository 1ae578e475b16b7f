"""The eight emulators of the paper; the registry of emulators reads the list when it is used."""

from regional_lv.emulators import Listed
from regional_lv.emulators.architecture import Architecture

EMULATORS = (
    Listed(
        "local_gp",
        "regional_lv.paper.emulators.local:LocalSingleGP",
        Architecture("L.GP", "GP", "local", "single-output"),
    ),
    Listed(
        "local_mgp",
        "regional_lv.paper.emulators.local:LocalMultiGP",
        Architecture("L.MGP", "GP", "local", "multi-output"),
    ),
    Listed(
        "local_dkgp",
        "regional_lv.paper.emulators.local:LocalDeepKernelGP",
        Architecture("L.DKGP", "GP", "local", "single-output", "deep kernel"),
    ),
    Listed(
        "local_dkmgp",
        "regional_lv.paper.emulators.local:LocalDeepKernelMultiGP",
        Architecture("L.DKMGP", "GP", "local", "multi-output", "deep kernel"),
    ),
    Listed(
        "vgp",
        "regional_lv.paper.emulators.variational:VGP",
        Architecture("VGP", "variational GP", "global", "single-output"),
    ),
    Listed(
        "mvgp",
        "regional_lv.paper.emulators.variational:MVGP",
        Architecture("MVGP", "variational GP", "global", "multi-output"),
    ),
    Listed(
        "dgp",
        "regional_lv.paper.emulators.dgp:DGP",
        Architecture("DGP", "variational GP", "global", "multi-output", "variational GP layers"),
    ),
    Listed(
        "dnn",
        "regional_lv.paper.emulators.dnn:DNN",
        Architecture("DNN", "network", "global", "multi-output", "feed-forward network"),
    ),
)
"""By name in the configuration."""
