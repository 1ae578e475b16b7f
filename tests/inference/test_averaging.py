"""The average over models: against mixtures in closed form and quadrature, and its files."""

from itertools import combinations

import numpy as np
import pytest
import torch

from regional_lv.inference.averaging import average
from regional_lv.inference.posteriors import load, write
from regional_lv.inference.potential import Potential
from regional_lv.inputs.scales import Logarithmic, Saturating
from regional_lv.inputs.space import Inputs, Role
from tests.inference.toys import (
    Emulator,
    Toy,
    closed_form,
    known_noise,
    linear_problem,
    toy_inputs,
)


@pytest.fixture(scope="module")
def linear_average():
    inputs = toy_inputs(2, measured=(0.3,), suspected=3, half=2.0)
    truth = [0.5, -0.3, 0.0, 0.15, 0.0, 0.2]
    problem = linear_problem(inputs, 12, truth, departure=1e-3 * torch.eye(12).double())
    return average(problem[0], 3, 0), *problem


def test_average_is_the_mixture(linear_average):
    found, potential, slopes, covariance = linear_average
    table = found.table()
    mean, square = np.zeros(6), np.zeros(6)
    for p, candidate in zip(found.probability, found.models, strict=True):
        wider = covariance + candidate.amplitude**2 * (potential.departure)
        _, centre, spread = closed_form(potential, slopes, wider, candidate.members)
        free = potential.free(candidate.members).numpy()
        mean[free] += p * centre.numpy()
        square[free] += p * (spread.diagonal() + centre.square()).numpy()
    sd = np.sqrt(square - mean**2)
    assert (np.abs(table["mean"] - mean) < 0.06 * sd + 1e-3).all()
    np.testing.assert_allclose(table["sd"], sd, rtol=0.1, atol=3e-3)
    as_is = closed_form(potential, slopes, covariance)
    free = table[potential.free().numpy()]
    np.testing.assert_allclose(free["as_is_sd"], as_is[2].diagonal().sqrt(), rtol=0.1)
    width = free["as_is_upper95"] - free["as_is_lower95"]
    np.testing.assert_allclose(width, 2 * 1.96 * free["as_is_sd"], rtol=0.1)


def test_evidence_by_sampling(linear_average):
    found, potential, slopes, covariance = linear_average
    sampled = [model for model in found.models if model.drawn and model.drawn.reliable]
    assert len(sampled) >= 5
    for model in sampled:
        wider = covariance + model.amplitude**2 * potential.departure
        expected, _, _ = closed_form(potential, slopes, wider, model.members)
        assert model.log_evidence == pytest.approx(expected, abs=4 * model.drawn.evidence_error)


def test_suspected_inputs(linear_average):
    found, potential, _, _ = linear_average
    table = found.table().loc[["c0", "c1", "c2"]]
    for k in potential.suspected:
        free = [k in c.members for c in found.models]
        assert found.probability_of(k) == pytest.approx(found.probability[free].sum())
    table = table[table["probability"] > 0.01]
    assert (table["free_lower95"] < table["free_mean"]).all() and len(table) >= 2
    # The mean over all models is that of the models in which it is free, and 0 elsewhere.
    expected = table["probability"] * table["free_mean"]
    np.testing.assert_allclose(table["mean"], expected, atol=2e-3)


def test_files(linear_average, tmp_path):
    found = linear_average[0]
    write(found.to_datatree(500, 3), tmp_path / "a.nc")
    data = load(tmp_path / "a.nc")
    assert dict(data.posterior.sizes) == {"chain": 1, "draw": 500, "input": 6}
    t0 = data.posterior["value"].sel(input="t0").to_numpy()
    row = found.table().loc["t0"]
    assert t0.mean() == pytest.approx(row["mean"], abs=0.2 * row["sd"])
    statistics = data.sample_stats
    assert float(statistics["probability"].sum()) == pytest.approx(1.0)
    assert list(statistics["model"].to_numpy()) == found.names and "as it is" in found.names
    # All sets were judged: their priors add up to those of the causes.
    prior = np.exp(statistics["log_prior"].to_numpy())
    assert prior.sum() == pytest.approx(1.0)
    known = data.constant_data
    np.testing.assert_allclose(prior @ statistics["holds"].to_numpy(), known["prior_probability"])
    assert (known["upper"].sel(input="c1"), known["lower"].sel(input="c1")) == (2.0, -2.0)
    # Draws of a model have the inputs at their nominal values that are not free in it.
    number = data.posterior["model_number"].to_numpy()[0]
    values = data.posterior["value"].to_numpy()[0]
    fixed = ~statistics["free"].to_numpy()[number]
    assert (values[fixed] == 0).all()
    share = np.bincount(number, minlength=len(found.probability)) / 500
    np.testing.assert_allclose(share, found.probability, atol=0.01)


def test_same_seed_same_answer():
    inputs = toy_inputs(2, suspected=3)
    potential, _, _ = linear_problem(inputs, 10, [0.3, 0.1, 0.2, 0.0, 0.0])
    first, second, other = (average(potential, 2, seed, draws=500) for seed in (1, 1, 2))
    assert first.table().equals(second.table())
    assert first.to_datatree(50, 1).posterior.equals(second.to_datatree(50, 1).posterior)
    assert not first.table().equals(other.table())


@pytest.mark.parametrize("scale", [Logarithmic(), Saturating(0.5)])
def test_what_the_data_do_not_see_is_uniform_in_its_unit(scale):
    """Beside an input that they do see; and it leaves the evidence as it is without it."""
    seen, unseen = Toy("t0", -20.0, 20.0), Toy("t1", 0.1, 5.0, scale=scale)
    y = torch.tensor([0.3, 0.2, 0.4, 0.1]).double()
    emulator = Emulator(lambda x: x[:, :1].expand(-1, 4), 1e-6 * torch.eye(4).double())
    both, one = (
        average(Potential(emulator, Inputs({}, members, {}), y, known_noise(4)), 0, 0, 4000)
        for members in ([seen, unseen], [seen])
    )
    row = both.table().loc["t1"]
    assert row["mean"] == pytest.approx(2.55, abs=0.1)
    assert row["sd"] == pytest.approx(4.9 / np.sqrt(12), rel=0.05)
    assert row["lower95"] == pytest.approx(0.1 + 0.025 * 4.9, abs=0.05)
    assert row["upper95"] == pytest.approx(5.0 - 0.025 * 4.9, abs=0.05)
    (found,), (expected,) = (each.models for each in (both, one))
    assert found.log_evidence == pytest.approx(expected.log_evidence, abs=0.05)
    if isinstance(scale, Logarithmic):  # the density rises as an exponential, as the fit has it
        assert float(found.fit.log_evidence) == pytest.approx(expected.log_evidence, abs=0.01)


class Place(Toy):
    """One of the places of a cause."""

    cause = "scar"

    @property
    def place(self):
        return self.name.removeprefix("scar_")


def test_places_of_a_cause():
    """Probabilities in closed form: sets share the probability of their size by what shares their
    inputs are of their causes; and what the average says of a cause and of its place."""
    members = [*toy_inputs(1, suspected=2, half=20.0)]
    members += [Place(f"scar_{place}", -20.0, 20.0, 0.0) for place in range(1, 5)]
    inputs = Inputs({}, members, {e.name: Role("suspected") for e in members[1:]})
    truth = [0.5, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0]
    potential, slopes, covariance = linear_problem(inputs, 8, truth)
    found = average(potential, 2, 0, draws=500)
    share = dict(zip(range(1, 7), [1, 1, 0.25, 0.25, 0.25, 0.25], strict=True))
    priors, logs = {}, []
    for size in range(3):
        sets = {m: np.prod([share[k] for k in m]) for m in combinations(range(1, 7), size)}
        priors |= {m: np.log(p / sum(sets.values()) / 3) for m, p in sets.items()}
    for model in found.models:
        assert model.log_prior == pytest.approx(priors[model.members])
        logs.append(closed_form(potential, slopes, covariance, model.members)[0] + model.log_prior)
    weight = np.exp(np.array(logs) - max(logs))
    scars = np.array([[k in m.members for k in range(3, 7)] for m in found.models])
    expected = (weight / weight.sum()) @ np.column_stack([scars.any(1), scars])
    assert found.probability_of_cause("scar") == pytest.approx(expected[0], abs=0.02)
    most = found.most_probable_of("scar")
    assert found.potential.inputs[most].place == "3"
    assert found.probability_of(most) == pytest.approx(expected[3], abs=0.02)
    assert 0.1 < expected[0] < 0.999


def test_model_that_is_impossible():
    """Ten noise sds off in the mean: the model as it is is still shown."""
    inputs = toy_inputs(2, suspected=1, half=4.0)
    potential, slopes, covariance = linear_problem(inputs, 30, [0.3, 0.1, 3.0], seed=1, sd=0.02)
    found = average(potential, 1, 0, draws=500)
    assert found.probability[found.base] == 0 and found.names[0] == "c0"
    table = found.table().loc[["t0", "t1"]]
    _, mean, spread = closed_form(potential, slopes, covariance)
    assert (
        np.abs(table["as_is_mean"] - mean.numpy()) < 0.3 * spread.diagonal().sqrt().numpy()
    ).all()
    assert (np.abs(table["mean"] - [0.3, 0.1]) < 4 * table["sd"]).all()
