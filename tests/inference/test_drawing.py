"""Draws and evidence of single models, against quadrature."""

import numpy as np
import pytest
import torch
from scipy import integrate, stats

from regional_lv.inference import drawing
from regional_lv.inference.averaging import average
from regional_lv.inference.drawing import approximate, sample
from regional_lv.inference.evidence import fit
from regional_lv.inference.noise import Noise
from regional_lv.inference.potential import Potential
from regional_lv.inputs.scales import Logarithmic
from regional_lv.inputs.space import Inputs, Role
from tests.inference.toys import (
    Emulator,
    Toy,
    closed_form,
    known_noise,
    linear,
    linear_problem,
    toy_inputs,
)


def fitted(potential, members=()):
    free, zero = potential.free(members)[None], torch.zeros(1).double()
    x = potential.nominal[None]
    return fit(potential, free, zero, x, potential.settle(x, zero), 60, 1e-8)


def test_inferred_noise():
    """Against quadrature over one input and the scale of its noise."""
    d = 8
    inputs = toy_inputs(1)
    noise = Noise(torch.zeros(d).double(), {"all": torch.full((d,), 0.5).double()}, 0.7)
    emulator = Emulator(lambda x: x.expand(-1, d), 1e-8 * torch.eye(d).double())
    y = torch.as_tensor(np.random.default_rng(0).normal(0.4, 0.2, d))
    found = average(Potential(emulator, inputs, y, noise), 0, 0)
    (one,) = (model.drawn for model in found.models)

    t, sigma = np.linspace(-1, 1, 401), np.linspace(0.05, 3, 401)[:, None, None]
    values = stats.norm(t[:, None], 0.5 * sigma).logpdf(y.numpy()).sum(-1)
    density = np.exp(values) * stats.halfnorm(scale=0.7).pdf(sigma[:, :, 0]) / 2
    sigma, of_sigma = sigma[:, 0, 0], integrate.simpson(density, x=t)
    evidence = integrate.simpson(of_sigma, x=sigma)
    mean = integrate.simpson(sigma * of_sigma, x=sigma)
    assert one.log_evidence == pytest.approx(np.log(evidence), abs=4 * one.evidence_error)
    sigma = found.to_datatree(2000, 0).posterior["sigma"]
    assert float(sigma.mean()) == pytest.approx(mean / evidence, rel=0.05)


@pytest.mark.parametrize("at", [(0.5, 0.5), (1.3, 1.2), (-0.4, 0.5)])
def test_bent_posterior_at_its_bounds(at):
    """A nonlinear effect of two inputs: evidence and mean against quadrature."""
    inputs = toy_inputs(1, suspected=1, ends=(("t0", 0.0, 1.0), ("c0", 0.0, 1.0)))
    a = torch.tensor([[1.0, 0.6], [0.3, 0.9], [0.8, 0.8], [0.5, 0.1]]).double()

    def function(x):
        return torch.sin(1.2 * x @ a.mT) + 0.3 * (x[:, :1] * x[:, 1:])

    y = function(torch.tensor([at]).double())[0]
    emulator = Emulator(function, torch.zeros(4, 4).double())
    potential = Potential(emulator, inputs, y, known_noise(4, 0.2))
    t = np.linspace(0, 1, 401)
    grid = torch.as_tensor(np.stack(np.meshgrid(t, t, indexing="ij"), -1).reshape(-1, 2))
    density = np.exp(stats.norm(0, 0.2).logpdf((y - function(grid)).numpy()).sum(-1))
    density = density.reshape(401, 401)

    def whole(values):
        return integrate.simpson(integrate.simpson(values, x=t), x=t)

    found = sample(potential, fitted(potential, (1,)), 2000, 0)
    evidence = whole(density)
    assert found.log_evidence == pytest.approx(np.log(evidence), abs=4 * found.evidence_error)
    mean = [whole(density * t[:, None]) / evidence, whole(density * t) / evidence]
    np.testing.assert_allclose(found.weight @ found.x, mean, atol=0.02)


@pytest.mark.parametrize("d", [9, 20])
def test_funnel_of_unknown_noise(d, monkeypatch):
    """Seven inputs beside a noise that few channels tell of: evidence and moments by quadrature
    over the scale, of closed forms given the scale; and one round of draws suffices."""
    monkeypatch.setattr(drawing, "MOST_ROUNDS", 1)
    inputs = toy_inputs(6, measured=(0.3,), half=30.0)
    slopes, emulator = linear(inputs, d, seed=3, error=0.01)
    emulator.error = emulator.error + 1e-4 * torch.eye(d)
    rng = np.random.default_rng(1)
    y = slopes @ torch.as_tensor(0.3 * rng.normal(size=7))
    y = y + torch.as_tensor(0.2 * rng.normal(size=d))
    unit = torch.full((d,), 0.5).double()
    potential = Potential(emulator, inputs, y, Noise(0 * unit, {"all": unit}, 0.7))
    found = sample(potential, fitted(potential), 4000, 0)

    known = Potential(emulator, inputs, y, known_noise(d))
    # From the least scale that the posterior has: with nine channels 4 % of it lie below 0.005.
    sigmas, logs, means = np.linspace(float(potential.low[-1].exp()), 3, 800), [], []
    for sigma in sigmas:
        covariance = emulator.error + torch.diag((sigma * unit).square())
        evidence, mean, _ = closed_form(known, slopes, covariance)
        logs.append(evidence + stats.halfnorm(scale=0.7).logpdf(sigma))
        means.append(mean.numpy())
    density = np.exp(np.array(logs) - max(logs))
    total = integrate.simpson(density, x=sigmas)
    expected = max(logs) + np.log(total)
    assert found.reliable and found.ess > 800
    assert found.log_evidence == pytest.approx(expected, abs=4 * found.evidence_error)
    sigma = float(found.weight @ found.x[:, -1].exp())
    assert sigma == pytest.approx(integrate.simpson(density * sigmas, x=sigmas) / total, rel=0.05)
    mean = integrate.simpson(density[:, None] * means, x=sigmas, axis=0) / total
    sd = ((found.weight @ found.x.square()) - (found.weight @ found.x).square()).sqrt()
    away = (found.weight @ found.x)[:-1] - torch.as_tensor(mean)
    assert (away.abs() < 0.15 * sd[:-1]).all()


def test_approximation_stays_in_its_ranges():
    inputs = toy_inputs(2, suspected=1, ends=(("t0", 0.0, 1.0),))
    slopes, emulator = linear(inputs, 6)
    y = slopes @ torch.tensor([1.1, 0.3, 0.0]).double()
    potential = Potential(emulator, inputs, y, known_noise(6))
    found = approximate(potential, fitted(potential), 4000, 0)
    assert (found.x >= potential.low).all() and (found.x <= potential.high).all()
    assert (found.x[:, 2] == 0).all() and not found.reliable
    exact = sample(potential, fitted(potential), 4000, 0)
    mean = exact.weight @ exact.x
    sd = (exact.weight @ (exact.x - mean).square()).sqrt()
    assert ((found.x.mean(0) - mean).abs() <= 0.15 * sd + 1e-12).all()


@pytest.mark.parametrize(("nominal", "sd"), [(8.0, 2.0), (5.0, 3.0), (15.0, 30.0)])
def test_measured_input_on_its_scale(nominal, sd):
    """A pressure, normal in its unit and cut at its range, beside a stiffness that it acts on,
    uniform in its own: both on logarithmic scales; evidence and means against quadrature."""
    members = [Toy("c", 0.2, 5.0, scale=Logarithmic()), Toy("p", 4, 16, nominal, Logarithmic())]
    inputs = Inputs({}, members, {"p": Role("measured", sd)})
    a = torch.tensor([[0.5, 0.4], [0.3, 0.1], [0.2, 0.4]]).double()

    def function(x):
        return torch.exp(0.5 * x @ a.mT)

    y = function(torch.tensor([[0.4, 2.0]]).double())[0] + 0.1
    emulator = Emulator(function, torch.zeros(3, 3).double())
    potential = Potential(emulator, inputs, y, known_noise(3, 0.15))
    found = sample(potential, fitted(potential), 4000, 0)
    z, p = np.linspace(np.log(0.2), np.log(5), 401), np.linspace(4, 16, 401)
    grid = np.stack(np.meshgrid(z, np.log(p), indexing="ij"), -1).reshape(-1, 2)
    errors = (y - function(torch.as_tensor(grid))).numpy()
    prior = stats.truncnorm((4 - nominal) / sd, (16 - nominal) / sd, nominal, sd).pdf(p)
    density = np.exp(stats.norm(0, 0.15).logpdf(errors).sum(-1)).reshape(401, 401)
    density = density * prior * np.exp(z)[:, None] / (5 - 0.2)

    def whole(values):
        return integrate.simpson(integrate.simpson(values, x=p), x=z)

    evidence = whole(density)
    assert found.log_evidence == pytest.approx(np.log(evidence), abs=4 * found.evidence_error)
    assert float(fitted(potential).log_evidence) == pytest.approx(np.log(evidence), abs=0.3)
    mean = found.weight @ found.x.exp()
    expected = [whole(density * np.exp(z)[:, None]) / evidence, whole(density * p) / evidence]
    np.testing.assert_allclose(mean, expected, rtol=0.03)


def test_fewer_channels_than_inputs():
    """Two channels and six inputs, one of them a cause: nothing is learnt of it."""
    inputs = toy_inputs(4, measured=(0.3,), suspected=1)
    slopes, emulator = linear(inputs, 2)
    y = slopes @ torch.full((6,), 0.2).double()
    found = average(Potential(emulator, inputs, y, known_noise(2)), 1, 0, draws=2000)
    assert found.probability_of(4) == pytest.approx(0.5, abs=0.15)
    table = found.table()
    assert (table["sd"][:4] > 0.3).all() and (table[["lower95", "upper95"]].abs() <= 1).all(
        axis=None
    )


class Uncertain(Emulator):
    """With errors that grow from one end of the range of the first input to the other."""

    def predict(self, x):
        return self.mean(x), self.error * torch.exp(2 * x[:, 0])[:, None, None]


@pytest.mark.parametrize("kept", [False, True])
@pytest.mark.parametrize("truth", [0.0, 0.6])
def test_errors_that_differ_within_a_posterior(truth, kept, monkeypatch):
    """Evidence and mean against quadrature, with the determinant of the covariance at each place;
    or with that of the fit, where no draws are reliable otherwise."""
    if kept:
        monkeypatch.setattr(drawing, "LEAST_ESS", np.inf)
    d = 6
    inputs = toy_inputs(1)
    emulator = Uncertain(lambda x: x.expand(-1, d), 0.25 * torch.eye(d).double())
    y = torch.as_tensor(np.random.default_rng(2).normal(truth, 0.5, d))
    potential = Potential(emulator, inputs, y, known_noise(d, 0.05))
    found = sample(potential, fitted(potential), 4000, 0)
    t = np.linspace(-1, 1, 2001)
    there = np.full_like(t, float(fitted(potential).x)) if kept else t
    sd = np.sqrt(0.25 * np.exp(2 * there) + 0.05**2)
    density = np.exp(stats.norm(t[:, None], sd[:, None]).logpdf(y.numpy()).sum(1)) / 2
    evidence = integrate.simpson(density, x=t)
    assert found.log_evidence == pytest.approx(np.log(evidence), abs=4 * found.evidence_error)
    mean = integrate.simpson(density * t, x=t) / evidence
    assert float(found.weight @ found.x[:, 0]) == pytest.approx(mean, abs=0.02)


def test_measured_inputs_with_near_ends():
    """Thirty that the outputs do not see keep their priors, cut where their ranges end, one and a
    half sds away; drawn without these ends, one draw in seventy would be within all of them."""
    ends = [(f"m{i}", -0.15, 0.15) for i in range(30)]
    inputs = toy_inputs(2, measured=(0.1,) * 30, ends=ends)
    potential, slopes, _ = linear_problem(inputs, 8, [0.2, -0.1] + [0.0] * 30)
    slopes[:, 2:] = 0
    found = sample(potential, fitted(potential), 1000, 0)
    assert found.reliable and found.ess > 200
    sd = (found.weight @ found.x[:, 2:].square()).sqrt()
    cut = stats.truncnorm(-1.5, 1.5, scale=0.1)
    assert float(sd.mean()) == pytest.approx(cut.std(), rel=0.03)


def test_a_model_whose_draws_are_all_lost_has_none(monkeypatch):
    inputs = toy_inputs(2)
    potential, _, _ = linear_problem(inputs, 8, [0.2, -0.1])
    start = fitted(potential)
    nothing = torch.full((1,), -torch.inf).double()
    monkeypatch.setattr(potential, "log_density", lambda mean, x, error: nothing.expand(len(x)))
    found = sample(potential, start, 100, 0)
    assert not found.reliable and found.ess == 0
