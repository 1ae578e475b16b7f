"""Where to simulate: Sobol sequences over the box of the parameters."""

from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.seeds import derive


def sobol(n: int, lower: np.ndarray, upper: np.ndarray, scale: str, seed: int) -> np.ndarray:
    """First `n` points (n, P) of a scrambled Sobol sequence between bounds (P,).

    `scale` "natural" spreads them evenly, "log" evenly in the logarithm.
    """
    from scipy.stats import qmc  # slow to import, and the workflow reads sizes from this module

    # Powers of two keep the sequence balanced; any prefix of the next one serves.
    exponent = max(int(np.ceil(np.log2(max(n, 1)))), 0)
    points = qmc.Sobol(len(lower), seed=seed).random_base2(exponent)[:n]
    if scale == "log":
        return np.exp(np.log(lower) + points * (np.log(upper) - np.log(lower)))
    return lower + points * (upper - lower)


def further_points(
    parameters: StiffnessInputs, seed: int, purpose: str, natural: int, log_scale: int
) -> np.ndarray:
    """Points of the box (n, P) that no set of the study has: `natural` ones, then log-scale ones.

    `purpose` makes the sequences independent.
    """
    return np.concatenate(
        [
            sobol(
                n,
                parameters.lower,
                parameters.upper,
                scale,
                derive(seed, "design", purpose, scale),
            )
            for n, scale in ((natural, "natural"), (log_scale, "log"))
        ]
    )


def make_design(design: dict, parameters: StiffnessInputs, seed: int) -> dict[str, pd.DataFrame]:
    """The sets `train` (natural, then log) and `test` (natural, a sequence of its own).

    `design` holds the sizes `natural`, `log` and `test`. Columns: `sample`, `scale`, the P
    parameters.
    """

    def table(name: str, scale: str, n: int) -> pd.DataFrame:
        theta = sobol(n, parameters.lower, parameters.upper, scale, derive(seed, "design", name))
        frame = pd.DataFrame(theta, columns=list(parameters.names))
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


def write_stiffness_design(
    design: dict, parameters: StiffnessInputs, seed: int, train: Path, test: Path
) -> None:
    """Write the sets of `make_design` (Parquet)."""
    sets = make_design(design, parameters, seed)
    sets["train"].to_parquet(train, index=False)
    sets["test"].to_parquet(test, index=False)
