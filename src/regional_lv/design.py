"""Where to simulate: Sobol sequences over the box of scaling factors."""

import numpy as np
import pandas as pd
from scipy.stats import qmc

from regional_lv import aha
from regional_lv.seeds import derive


def sobol(n: int, lower: float, upper: float, scale: str, seed: int) -> np.ndarray:
    """First `n` points (n, 10) of a scrambled Sobol sequence on [lower, upper]^10.

    `scale` "natural" spreads them evenly, "log" evenly in the logarithm.
    """
    # Powers of two keep the sequence balanced; any prefix of the next one serves.
    exponent = max(int(np.ceil(np.log2(max(n, 1)))), 0)
    points = qmc.Sobol(len(aha.PARAMETERS), seed=seed).random_base2(exponent)[:n]
    if scale == "log":
        return np.exp(np.log(lower) + points * (np.log(upper) - np.log(lower)))
    return lower + points * (upper - lower)


def further_points(
    design: dict, seed: int, purpose: str, natural: int, log_scale: int
) -> np.ndarray:
    """Points of the box (n, 10) that no set of the study has: `natural` ones, then log-scale ones.

    `design` is the config section; `purpose` makes the sequences independent.
    """
    return np.concatenate(
        [
            sobol(
                n, design["lower"], design["upper"], scale, derive(seed, "design", purpose, scale)
            )
            for n, scale in ((natural, "natural"), (log_scale, "log"))
        ]
    )


def make_design(design: dict, seed: int) -> dict[str, pd.DataFrame]:
    """The sets `train` (natural, then log) and `test` (natural, a sequence of its own).

    Columns: `sample`, `scale`, the ten parameters.
    """

    def table(name: str, scale: str, n: int) -> pd.DataFrame:
        theta = sobol(n, design["lower"], design["upper"], scale, derive(seed, "design", name))
        frame = pd.DataFrame(theta, columns=list(aha.PARAMETERS))
        frame.insert(0, "scale", scale)
        return frame

    train = pd.concat(
        [table("natural", "natural", design["natural"]), table("log", "log", design["log"])],
        ignore_index=True,
    )
    sets = {"train": train, "test": table("test", "natural", design["test"])}
    for frame in sets.values():
        frame.insert(0, "sample", np.arange(len(frame)))
    return sets
