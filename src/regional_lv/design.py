"""Where to simulate: Sobol sequences over the box of scaling factors, and simulated disease."""

import numpy as np
import pandas as pd
from scipy.stats import qmc, truncnorm

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


def draw_scenario(
    name: str, scenario: dict, healthy: dict, lower: float, upper: float, seed: int
) -> pd.DataFrame:
    """Ventricles of one disease scenario: columns `sample`, `scale`, ten parameters, `zone`.

    scenario: an entry of `scenarios.sets`. `local`: `samples_per_zone` ventricles for each of the
    five zones, whose C_a and C_b are drawn from N(mu, sd) and those of the other zones from
    N(healthy mean, healthy sd); `zone` names the stiff one. `global`: `samples` ventricles, all
    zones drawn from N(mu, sd); `zone` is `all`. All draws are independent, from normal
    distributions truncated to [lower, upper]. `scale` is the scenario's name. seed: the study's.
    """
    rng = np.random.default_rng(derive(seed, "scenario", name))

    def draw(mean: float, sd: float, rows: int, columns: int) -> np.ndarray:
        ends = (np.array([lower, upper]) - mean) / sd
        return truncnorm(*ends, loc=mean, scale=sd).rvs((rows, columns), random_state=rng)

    if scenario["kind"] == "global":
        zones = ["all"] * scenario["samples"]
        theta = draw(scenario["mu"], scenario["sd"], len(zones), len(aha.PARAMETERS))
    else:
        zones = list(np.repeat(aha.ZONES, scenario["samples_per_zone"]))
        theta = draw(healthy["mean"], healthy["sd"], len(zones), len(aha.PARAMETERS))
        stiff = draw(scenario["mu"], scenario["sd"], len(zones), 2)
        for row, zone in enumerate(zones):
            at = 2 * aha.ZONES.index(zone)
            theta[row, at : at + 2] = stiff[row]
    table = pd.DataFrame(theta, columns=list(aha.PARAMETERS))
    table.insert(0, "sample", np.arange(len(table)))
    table.insert(1, "scale", name)
    table["zone"] = zones
    return table


def scenario_size(scenario: dict) -> int:
    """Number of ventricles of an entry of `scenarios.sets`."""
    if scenario["kind"] == "global":
        return scenario["samples"]
    return len(aha.ZONES) * scenario["samples_per_zone"]
