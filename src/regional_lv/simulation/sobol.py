"""Where to simulate: Sobol sequences over the box of the parameters, and simulated disease."""

from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.inputs.parameters import Parameterisation
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
    parameters: Parameterisation, seed: int, purpose: str, natural: int, log_scale: int
) -> np.ndarray:
    """Points of the box (n, P) that no set of the study has: `natural` ones, then log-scale ones.

    `purpose` makes the sequences independent.
    """
    return np.concatenate(
        [
            sobol(
                *(n, parameters.lower, parameters.upper, scale),
                derive(seed, "design", purpose, scale),
            )
            for n, scale in ((natural, "natural"), (log_scale, "log"))
        ]
    )


def make_design(design: dict, parameters: Parameterisation, seed: int) -> dict[str, pd.DataFrame]:
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


def write_design(
    design: dict, parameters: Parameterisation, seed: int, train: Path, test: Path
) -> None:
    """Write the sets of `make_design` (Parquet)."""
    sets = make_design(design, parameters, seed)
    sets["train"].to_parquet(train, index=False)
    sets["test"].to_parquet(test, index=False)


def draw_scenario(
    name: str, scenario: dict, healthy: dict, parameters: Parameterisation, seed: int
) -> pd.DataFrame:
    """Ventricles of one disease scenario: columns `sample`, `scale`, P parameters, `zone`.

    scenario: an entry of `scenarios.sets`. `local`: `samples_per_zone` ventricles for each zone in
    turn, whose factors are all drawn from N(mu, sd) and those of the other zones from N(healthy
    mean, healthy sd); `zone` names the stiff one. `global`: `samples` ventricles, all zones drawn
    from N(mu, sd); `zone` is `all`. All draws are independent, from normal distributions truncated
    to the bounds. `scale` is the scenario's name. seed: the study's.
    """
    from scipy.stats import truncnorm  # here for the same reason as in `sobol`

    rng = np.random.default_rng(derive(seed, "scenario", name))

    def draw(mean: float, sd: float, rows: int, at: slice) -> np.ndarray:
        lower, upper = parameters.lower[at], parameters.upper[at]
        # By inversion of uniform numbers: as many for any bounds, row by row.
        uniform = rng.uniform(size=(rows, len(lower)))
        return truncnorm.ppf(uniform, (lower - mean) / sd, (upper - mean) / sd, mean, sd)

    everywhere = slice(None)
    if scenario["kind"] == "global":
        zones = ["all"] * scenario["samples"]
        theta = draw(scenario["mu"], scenario["sd"], len(zones), everywhere)
    else:
        zones = list(np.repeat(parameters.zone_names, scenario["samples_per_zone"]))
        theta = draw(healthy["mean"], healthy["sd"], len(zones), everywhere)
        # A factor's bounds are the same in every zone: those of the first serve for all.
        stiff = draw(scenario["mu"], scenario["sd"], len(zones), parameters.blocks[0])
        for row, zone in enumerate(zones):
            theta[row, parameters.of_zone(zone)] = stiff[row]
    table = pd.DataFrame(theta, columns=list(parameters.names))
    table.insert(0, "sample", np.arange(len(table)))
    table.insert(1, "scale", name)
    table["zone"] = zones
    return table


def write_scenario(
    name: str,
    scenario: dict,
    healthy: dict,
    parameters: Parameterisation,
    seed: int,
    table: Path,
) -> None:
    """Write the ventricles of `draw_scenario` (Parquet)."""
    draw_scenario(name, scenario, healthy, parameters, seed).to_parquet(table, index=False)


def scenario_size(scenario: dict, parameters: Parameterisation) -> int:
    """Number of ventricles of an entry of `scenarios.sets`."""
    if scenario["kind"] == "global":
        return scenario["samples"]
    return len(parameters.zones) * scenario["samples_per_zone"]
