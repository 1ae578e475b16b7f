"""Simulated disease: ventricles of which one zone, or every zone, is stiffened."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.seeds import derive


def draw_scenario(
    name: str, scenario: dict, healthy: dict, parameters: StiffnessInputs, seed: int
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


def stiffened(zone, stiff):
    """Whether `zone` is a stiff one, where `stiff` is a zone or `all`; of columns, row by row."""
    return (zone == stiff) | (stiff == "all")


def labels_of(scenarios: Mapping[str, Mapping]) -> dict[str, str]:
    """What figures call the scenarios (`scenarios.sets`): by kind and mean, or by name where others
    have the same."""
    labels = {name: f"{each['kind']}, μ = {each['mu']:g}" for name, each in scenarios.items()}
    count = Counter(labels.values())
    return {name: label if count[label] == 1 else name for name, label in labels.items()}


def write_scenario(
    name: str,
    scenario: dict,
    healthy: dict,
    parameters: StiffnessInputs,
    seed: int,
    table: Path,
) -> None:
    """Write the ventricles of `draw_scenario` (Parquet)."""
    draw_scenario(name, scenario, healthy, parameters, seed).to_parquet(table, index=False)
