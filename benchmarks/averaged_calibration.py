"""Simulation-based calibration of the posterior averaged over models (Talts et al. 2018,
arXiv:1804.06788), on the emulator of any heart.

    python benchmarks/averaged_calibration.py draw FOLDER CONFIG FIRST LAST
    python benchmarks/averaged_calibration.py score FOLDER

CONFIG: of a heart (`regional-lv new`); what was measured of it does not matter. Draws from FIRST up
to LAST, each with a seed of its own: a model from the prior over sets of suspected inputs and
smooth departures, all its inputs from their priors, and a measurement from the emulator, with its
stated error, the departure and normal noise (0.02 in strains, 2 mL). Its posterior averaged over
models is made as for a user's heart; the pressure, which data cannot tell from the stiffness, and
the noise are known. FOLDER gets a file (JSON) a draw; one that is there is not made again.

`score`: 95 % intervals and ranks of stiffness, measured inputs and effects (of an effect that is
not there, too: its posterior has a point mass), and how often causes are there that have a certain
probability. `ranks.csv`: quantity, draw, rank (a share); `probabilities.csv`: cause, draw,
probability, present.
"""

import json
import sys
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from scipy import stats

from regional_lv import config as study_config
from regional_lv.channels import Channels
from regional_lv.criticism.identifiable import absorbed_inputs
from regional_lv.criticism.linear_model import LinearModel
from regional_lv.hearts import ONE_HEART
from regional_lv.hearts.file import shipped
from regional_lv.hearts.reach import within
from regional_lv.inference.averaging import average
from regional_lv.inference.hearts import potential_of_tables
from regional_lv.inference.potential import Potential
from regional_lv.inference.sets import AMPLITUDES, Prior, fit_base
from regional_lv.inputs.space import Inputs, Role, sections_of
from regional_lv.measured import synthetic_subject

LARGEST, DRAWS = 3, 4000
NOISE = {"strain": 0.02, "volume": 2.0}
KNOWN = ("end_diastolic_pressure", "heavy_tails")
BINS = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0)


def read_heart(path: str) -> tuple[Inputs, object]:
    """Inputs and emulator of a heart."""
    given = study_config.merged(study_config.read(ONE_HEART), study_config.read(path))
    any_heart = shipped()
    config = study_config.load(given, path, [str(Path(path).parent)])
    config, _ = within(config, any_heart.emulator, any_heart.known)
    physics = sections_of(config)
    inputs = Inputs.from_config(physics)
    roles = dict(zip(inputs.names, inputs.roles, strict=True)) | dict.fromkeys(KNOWN, Role("fixed"))
    return Inputs(physics, inputs, roles), any_heart.of_heart(physics, Channels.from_config(config))


def potential_of(emulator, inputs: Inputs, outputs: np.ndarray) -> Potential:
    """Of a measurement."""
    table = synthetic_subject(outputs, emulator.channels, NOISE, np.zeros(len(outputs)))
    return potential_of_tables(emulator, inputs, {"drawn": table}, 1.0)


def models_of(potential: Potential) -> tuple[list[tuple], np.ndarray]:
    """Members and amplitude of all models, and their prior probabilities."""
    prior = Prior.of(potential, LARGEST)
    sets = [m for size in range(LARGEST + 1) for m in combinations(potential.searched, size)]
    models = [(members, 0.0) for members in sets] + [((), a) for a in AMPLITUDES]
    logs = [prior(members) for members in sets]
    logs += [prior(()) - np.log(len(AMPLITUDES))] * len(AMPLITUDES)
    return models, np.exp(logs) / np.exp(logs).sum()


def from_prior(inputs: Inputs, members, rng: np.random.Generator) -> np.ndarray:
    """Values (K,) of the inputs of a model."""
    x = inputs.nominal.copy()
    for k, (each, role) in enumerate(zip(inputs, inputs.roles, strict=True)):
        if role.kind == "inferred":
            x[k] = rng.uniform(each.low, each.high)
        elif role.kind == "measured":
            ends = ((end - x[k]) / role.sd for end in (each.low, each.high))
            x[k] = stats.truncnorm(*ends, x[k], role.sd).rvs(random_state=rng)
        elif k in members:
            low, high = each.scale(each.low), each.scale(each.high)
            x[k] = each.scale.inverse(float(rng.uniform(low, high)))
    return x


def draw(folder: str, path: str, first: str, last: str) -> None:
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    inputs, emulator = read_heart(path)
    start = potential_of(
        emulator,
        inputs,
        emulator.predict_mean(torch.as_tensor(inputs.simulated.nominal)[None])[0].numpy(),
    )
    models, shares = models_of(start)
    for number in range(int(first), int(last)):
        file = place / f"{number:05d}.json"
        if file.exists():
            continue
        rng = np.random.default_rng([57, number])
        members, amplitude = models[rng.choice(len(models), p=shares)]
        truth = from_prior(inputs, members, rng)
        x = torch.as_tensor(inputs.coordinates.scaled(truth))[None]
        generator = torch.Generator().manual_seed(number)
        y = start.replicates(x, torch.tensor([amplitude]).double(), generator)[0].numpy()
        potential = potential_of(emulator, inputs, y)
        base = fit_base(potential, number)
        absorbed = absorbed_inputs(LinearModel.of(potential, base))
        averaged = average(potential.without(absorbed), LARGEST, number, base=base)
        drawn = averaged.to_datatree(DRAWS, number).posterior["value"][0].to_numpy()
        ranks = {}
        for k, (name, role) in enumerate(zip(inputs.names, inputs.roles, strict=True)):
            if role.kind != "fixed" and k not in absorbed:
                close = np.isclose(drawn[:, k], truth[k], rtol=1e-9, atol=1e-12)
                below = ((drawn[:, k] < truth[k]) & ~close).mean()
                ranks[name] = float(below + rng.uniform() * close.mean())
        causes = averaged.potential.causes
        made = {
            "members": [inputs.names[k] for k in members],
            "absorbed": [inputs.names[k] for k in absorbed],
            "amplitude": amplitude,
            "ess": averaged.ess,
            "ranks": ranks,
            "present": {c: bool({*places} & {*members}) for c, places in causes.items()},
            "probability": {c: averaged.probability_of_cause(c) for c in causes},
            "departure": averaged.departure_probability,
        }
        file.write_text(json.dumps(made))
        print(number, made["members"], amplitude, f"{averaged.ess:.0f} draws count", flush=True)


def score(folder: str) -> None:
    place = Path(folder)
    found = {path.stem: json.loads(path.read_text()) for path in sorted(place.glob("*.json"))}
    ranks = pd.DataFrame(
        [
            {"quantity": name, "draw": draw, "rank": rank}
            for draw, one in found.items()
            for name, rank in one["ranks"].items()
        ]
    )
    chances = pd.DataFrame(
        [
            {"cause": cause, "draw": draw, "probability": p, "present": one["present"][cause]}
            for draw, one in found.items()
            for cause, p in one["probability"].items()
            if cause not in one["absorbed"]
        ]
        + [
            {
                "cause": "departure",
                "draw": draw,
                "probability": one["departure"],
                "present": one["amplitude"] > 0,
            }
            for draw, one in found.items()
        ]
    )
    ranks.to_csv(place / "ranks.csv", index=False, float_format="%.4g")
    chances.to_csv(place / "probabilities.csv", index=False, float_format="%.4g")
    print(f"{len(found)} draws")
    by = ranks.groupby("quantity", sort=False)["rank"]
    table = pd.DataFrame(
        {
            "held95": by.apply(lambda r: ((r > 0.025) & (r < 0.975)).mean()),
            "held50": by.apply(lambda r: ((r > 0.25) & (r < 0.75)).mean()),
            "uniform_p": by.apply(lambda r: stats.kstest(r, "uniform").pvalue),
        }
    )
    print(table.round(3).to_string())
    bins = pd.cut(chances["probability"], BINS, include_lowest=True)
    print(
        chances.groupby(bins, observed=True)
        .agg(cases=("present", "size"), stated=("probability", "mean"), present=("present", "mean"))
        .round(3)
        .to_string()
    )


if __name__ == "__main__":
    {"draw": draw, "score": score}[sys.argv[1]](*sys.argv[2:])
