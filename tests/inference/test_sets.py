"""The search over sets: probabilities of models in closed form, and by enumeration."""

from itertools import combinations

import numpy as np
import pytest
import torch

from regional_lv.inference import sets
from regional_lv.inference.evidence import fit
from regional_lv.inference.noise import Noise
from regional_lv.inference.potential import Potential
from regional_lv.inference.sets import AMPLITUDES, fit_base, search
from regional_lv.inputs.closed_forms import HeavyTails
from regional_lv.inputs.space import Inputs
from tests.inference.toys import Emulator, closed_form, known_noise, linear_problem, toy_inputs


def probabilities(candidates) -> dict:
    logs = torch.tensor([c.log_posterior for c in candidates], dtype=torch.float64)
    weights = torch.softmax(logs, 0).tolist()
    return {(c.members, c.amplitude): w for c, w in zip(candidates, weights, strict=True)}


def normalised(logs: dict) -> dict:
    values = np.array([*logs.values()])
    weights = np.exp(values - values.max())
    return dict(zip(logs, weights / weights.sum(), strict=True))


def subsets(potential, largest):
    places = potential.suspected
    return [s for size in range(largest + 1) for s in combinations(places, size)]


def test_priors():
    """Sizes share the probability evenly, and a departure has that of a size."""
    inputs = toy_inputs(1, suspected=4)
    pattern = 1e-4 * torch.eye(8).double()
    potential, _, _ = linear_problem(inputs, 8, np.zeros(5), departure=pattern)
    found = search(potential, 3, fit_base(potential, 0))
    total = {}
    for candidate in found:
        kind = "departure" if candidate.amplitude else len(candidate.members)
        total[kind] = total.get(kind, 0.0) + np.exp(candidate.log_prior)
    assert total == pytest.approx({kind: 1 / 5 for kind in (0, 1, 2, 3, "departure")})
    assert sum(1 for c in found if c.amplitude) == len(AMPLITUDES)


def test_linear_problem():
    inputs = toy_inputs(2, measured=(0.3,), suspected=5, half=20.0)
    truth = [0.5, -0.3, 0.0, 0.4, 0.0, 0.1, 0.0, 0.2]
    potential, slopes, covariance = linear_problem(inputs, 12, truth)
    found = search(potential, 3, fit_base(potential, 0))
    assert len(found) == len(subsets(potential, 3))
    logs = {}
    for candidate in found:
        evidence, _, _ = closed_form(potential, slopes, covariance, candidate.members)
        logs[candidate.members, 0.0] = evidence + candidate.log_prior
    assert probabilities(found) == pytest.approx(normalised(logs), abs=1e-6)


def test_departure_in_closed_form():
    """It is the model as it is with a larger covariance."""
    inputs = toy_inputs(2, suspected=2, half=20.0)
    pattern = 0.01 * torch.eye(12).double()
    potential, slopes, covariance = linear_problem(inputs, 12, [0.1, 0, 0, 0], departure=pattern)
    for candidate in search(potential, 2, fit_base(potential, 0)):
        if candidate.amplitude:
            wider = covariance + candidate.amplitude**2 * pattern
            expected, _, _ = closed_form(potential, slopes, wider)
            assert candidate.log_evidence == pytest.approx(expected, abs=1e-4)


def nonlinear(seed, noise=None, suspected=6, tails=False, outlier=0.0):
    """Two inferred inputs, and suspected ones with saturating effects, two of which are there."""
    inputs = toy_inputs(2, suspected=suspected, ends=[(f"c{i}", 0.0, 1.0) for i in range(3)])
    if tails:
        roles = dict(zip(inputs.names, inputs.roles, strict=True))
        tail = HeavyTails({})
        inputs = Inputs({}, [*inputs, tail], roles | {tail.name: roles["c0"]})
    d, k = 20, 2 + suspected
    rng = np.random.default_rng(seed)
    a, b = (torch.as_tensor(rng.normal(size=(k, d))) for _ in range(2))

    def function(x):
        x = x[:, :k]
        return torch.tanh(x) @ a + 0.4 * (x.square() @ b)

    truth = torch.zeros(1, k).double()
    truth[0, :4] = torch.tensor([0.4, -0.3, 0.35, 0.0])
    truth[0, -1] = -0.5
    y = function(truth)[0] + torch.as_tensor(rng.normal(size=d) * 0.2)
    y[3] += outlier
    error = 0.03**2 * (torch.eye(d) + 0.5).double()
    return Potential(Emulator(function, error), inputs, y, noise or known_noise(d, 0.2))


def enumerated(potential, candidates, largest, seed=0):
    """Probabilities of all sets, each fitted from eight places."""
    rng = np.random.default_rng(seed)
    prior = {len(c.members): c.log_prior for c in candidates}
    logs = {}
    for members in subsets(potential, largest):
        free = potential.free(members).expand(8, -1)
        share = torch.as_tensor(rng.uniform(size=free.shape))
        x = torch.where(free, potential.low + share * potential.width, potential.nominal)
        x[0] = potential.nominal
        count = len(potential.inputs)
        x[:, count:] = potential.nominal[count:]
        zero = torch.zeros(8).double()
        fits = fit(potential, free, zero, x, potential.settle(x, zero), 60, 1e-6)
        logs[members, 0.0] = float(fits.log_evidence.max()) + prior[len(members)]
    return normalised(logs)


def present(found: dict, k: int) -> float:
    return sum(weight for (members, _), weight in found.items() if k in members)


UNKNOWN = Noise(torch.zeros(20).double(), {"all": torch.full((20,), 0.5).double()})


@pytest.mark.parametrize(
    "problem",
    [
        pytest.param({"seed": 1}, id="known noise"),
        pytest.param({"seed": 2, "suspected": 5}, id="again"),
        pytest.param({"seed": 3, "noise": UNKNOWN}, id="inferred noise"),
        pytest.param({"seed": 4, "tails": True, "suspected": 4}, id="heavy tails"),
    ],
)
def test_search_agrees_with_enumeration(problem, monkeypatch):
    """Although few sets of a size are fitted."""
    monkeypatch.setattr(sets, "FITTED", 4)
    monkeypatch.setattr(sets, "FITTED_BEYOND", 4)
    monkeypatch.setattr(sets, "BEAM", 2)
    potential = nonlinear(**problem)
    candidates = search(potential, 4, fit_base(potential, 0))
    assert sum(c.fit is None for c in candidates) >= 5
    found, expected = probabilities(candidates), enumerated(potential, candidates, 4)
    for k in potential.suspected:
        assert present(found, k) == pytest.approx(present(expected, k), abs=0.02)


def test_heavy_tails_are_found():
    """One channel fifteen standard deviations off."""
    found = {}
    for outlier in (0.0, 3.0):
        potential = nonlinear(5, tails=True, suspected=5, outlier=outlier)
        found[outlier] = present(
            probabilities(search(potential, 3, fit_base(potential, 0))), potential.suspected[-1]
        )
    assert found[0.0] < 0.3 and found[3.0] > 0.95


def test_no_suspected_input():
    potential, slopes, covariance = linear_problem(toy_inputs(2, half=20.0), 6, [0.1, 0.2])
    (found,) = search(potential, 3, fit_base(potential, 0))
    expected, _, _ = closed_form(potential, slopes, covariance)
    assert found.members == () and found.log_prior == 0.0
    assert found.log_evidence == pytest.approx(expected, abs=1e-4)


def test_larger_sets_are_reached():
    """Four effects, of which no one and no pair does much alone."""
    inputs = toy_inputs(1, suspected=7, half=3.0)
    truth = [0.2, 1.0, -1.0, 1.2, 0.9, 0.0, 0.0, 0.0]
    potential, _, _ = linear_problem(inputs, 16, truth)
    found = search(potential, 5, fit_base(potential, 0))
    assert set(found[0].members) >= {1, 2, 3, 4}
    assert max(len(c.members) for c in found) == 5
