"""What the average says of models, effects and stiffness that are drawn from the prior."""

import numpy as np
import pandas as pd
import pytest
import torch
from scipy import stats

from regional_lv.inference.averaging import average
from regional_lv.inference.potential import Potential
from regional_lv.inference.sets import AMPLITUDES
from tests.inference.toys import Emulator, known_noise, toy_inputs

DRAWS, D, LARGEST, NOISE, SD = 200, 12, 2, 0.1, 0.2
INPUTS = toy_inputs(2, measured=(SD,), suspected=3, ends=(("c0", 0.0, 1.0),))
PATTERN = (
    2.5e-3 * (torch.eye(D) + 0.5 * (torch.eye(2).repeat_interleave(D // 2, 0)[:, :1])).double()
)
PATTERN = 0.5 * (PATTERN + PATTERN.mT)
ERROR = 1e-3 * (torch.eye(D) + 0.5).double()
SURE = 0.999
"""Of the binomial bounds: of a hundred runs with other seeds, one or two would fail."""


RNG = np.random.default_rng(8)
A, B = (torch.as_tensor(RNG.normal(size=(len(INPUTS), D))) for _ in range(2))


class Saturating(Emulator):
    """Outputs that rise and saturate, and in which inputs act together."""

    def mean(self, x):
        return 0.6 * torch.tanh(0.75 * x @ A) + 0.15 * (x @ B).square()

    def linearise(self, x):
        rise = 0.45 * (1 - torch.tanh(0.75 * x @ A).square())
        return self.mean(x), rise[..., None] * A.mT + 0.3 * (x @ B)[..., None] * B.mT


EMULATOR = Saturating(None, ERROR)


def drawn(seed: int):
    """Values (K,), members, amplitude and observations of one draw of the prior."""
    rng = np.random.default_rng(seed)
    suspected = np.flatnonzero(INPUTS.of_role("suspected"))
    size, amplitude = int(rng.integers(LARGEST + 2)), 0.0
    if size > LARGEST:
        size, amplitude = 0, rng.choice(AMPLITUDES)
    members = tuple(sorted(rng.choice(suspected, size, replace=False).tolist()))
    x = rng.uniform(INPUTS.lower, INPUTS.upper)
    measured = INPUTS.of_role("measured")
    x[measured] = rng.normal(0, SD)
    x[[k for k in suspected if k not in members]] = 0.0
    covariance = ERROR + NOISE**2 * torch.eye(D) + amplitude**2 * PATTERN
    y = EMULATOR.mean(torch.as_tensor(x)[None])[0].numpy()
    return x, members, amplitude, torch.as_tensor(rng.multivariate_normal(y, covariance.numpy()))


@pytest.fixture(scope="module")
def answers() -> pd.DataFrame:
    """One row for each input of each draw; and one, `departure`, for that."""
    rows = []
    for seed in range(DRAWS):
        x, members, amplitude, y = drawn(seed)
        potential = Potential(EMULATOR, INPUTS, y, known_noise(D, NOISE), PATTERN)
        found = average(potential, LARGEST, seed, draws=600)
        table = found.table()
        table["truth"] = x
        table["there"] = [float(k in members) for k in range(len(INPUTS))]
        departure = {"probability": found.departure_probability, "there": amplitude > 0}
        rows += [table, pd.DataFrame({**departure, "role": "departure"}, index=["departure"])]
    return pd.concat(rows)


def holds(hits: int, count: int, probability: float) -> bool:
    low, high = stats.binom.interval(SURE, count, probability)
    return low <= hits <= high


@pytest.mark.parametrize("name", ["t0", "t1", "m0"])
def test_intervals_cover(answers, name):
    row = answers.loc[name]
    inside = (row["lower95"] <= row["truth"]) & (row["truth"] <= row["upper95"])
    assert holds(int(inside.sum()), DRAWS, 0.95), inside.mean()


def test_intervals_of_effects_cover(answers):
    there = answers[(answers["role"] == "suspected") & (answers["there"] == 1)]
    there = there[there["free_mean"].notna()]
    inside = (there["free_lower95"] <= there["truth"]) & (there["truth"] <= there["free_upper95"])
    assert len(there) > 100 and holds(int(inside.sum()), len(there), 0.95), inside.mean()


@pytest.mark.parametrize("role", ["suspected", "departure"])
@pytest.mark.parametrize(("low", "high"), [(0, 0.1), (0.1, 0.4), (0.4, 1.0), (0, 1)])
def test_probabilities_are_calibrated(answers, role, low, high):
    row = answers[answers["role"] == role]
    row = row[(row["probability"] >= low) & (row["probability"] <= high)]
    p = row["probability"]
    # Poisson's binomial distribution, as normal.
    off = (row["there"] - p).sum() / np.sqrt((p * (1 - p)).sum() + 0.25)
    assert len(row) > 15 and abs(off) < stats.norm.ppf((1 + SURE) / 2), (len(row), off)


def test_model_as_it_is_covers_less(answers):
    """The same intervals of the model as it is: what averaging is for."""
    row = answers.loc[["t0", "t1"]]
    inside = (row["as_is_lower95"] <= row["truth"]) & (row["truth"] <= row["as_is_upper95"])
    assert inside.mean() < 0.8
