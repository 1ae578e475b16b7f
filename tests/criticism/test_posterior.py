"""Posterior, evidence and leave-one-out prediction against closed forms."""

import math

import numpy as np
import pytest
import torch

from regional_lv.criticism.critic import Critic
from regional_lv.criticism.discrepancy import unlisted_covariance, unlisted_pattern
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.fit import fit, fit_best, fit_from_nothing
from regional_lv.criticism.linear import approximate, leave_out_linearly
from regional_lv.criticism.model import Layout, Model
from regional_lv.criticism.observations import observe
from regional_lv.criticism.posterior import gain_of, laplace, leave_out, sample
from regional_lv.criticism.search import log_evidence as evidence_of_fit
from regional_lv.criticism.together import Together
from regional_lv.criticism.verdict import Settings
from regional_lv.gaussian import LOG_2PI
from regional_lv.inference.target import BLUR
from tests.criticism.toy import PARAMETERS, THETA, ToyEmulator, bias, measured


def log_evidence(model: Model, keep=None) -> float:
    """Closed form of a linear model far from its bounds: a normal likelihood in log theta and psi,
    under a prior that is the exponential of the sum of log theta."""
    keep = torch.ones(len(model.observations.outputs), dtype=torch.bool) if keep is None else keep
    x0 = torch.zeros(1, len(model.low)).double()
    mean, slopes = model.linearise(x0)
    y = (model.observations.y - mean)[0, 0, keep]
    slopes = slopes[0, 0, keep]
    covariance = model.covariance(x0)[0, 0][keep][:, keep]
    inverse = torch.linalg.inv(covariance)
    precision = slopes.T @ inverse @ slopes
    tilt = torch.zeros(len(precision)).double()
    tilt[:10] = 1.0
    right = slopes.T @ inverse @ y + tilt
    solved = torch.linalg.solve(precision, right)
    value = -0.5 * (y @ inverse @ y - right @ solved)
    value += -0.5 * (torch.logdet(covariance) + len(y) * LOG_2PI)
    value += 0.5 * (len(right) * LOG_2PI - torch.logdet(precision))
    value -= float(np.log(PARAMETERS.upper - PARAMETERS.lower).sum())
    value -= (model.high - model.low)[10:].log().sum()
    return float(value), solved, torch.linalg.inv(precision)


def build(extensions=(), seed=0, strain=0.002):
    emulator = ToyEmulator(bend=0.0)
    o = observe({"a": measured(emulator, seed=seed, strain=strain)}, emulator, 1.0)
    return Model(o, ExtendedEmulator(emulator, extensions), Layout.inferred(("a",), PARAMETERS))


@pytest.fixture(scope="module")
def base():
    model = build()
    best = fit_from_nothing(model, 1)
    return model, best, sample(model, *laplace(model, best), 1000, 2)


def test_evidence_and_moments(base):
    model, _, posterior = base
    exact, mean, covariance = log_evidence(model)
    assert posterior.log_evidence == pytest.approx(exact, abs=4 * posterior.evidence_error + 0.02)
    found, sd = posterior.moments(posterior.x)
    assert torch.allclose(sd, covariance.diagonal().sqrt(), rtol=0.12)
    assert ((found - mean).abs() < 0.15 * sd).all()


def test_mixtures_of_proposals_find_the_same(base, monkeypatch):
    """What hard posteriors get, on one whose evidence is known."""
    monkeypatch.setattr("regional_lv.criticism.posterior.LEAST_ESS", math.inf)
    monkeypatch.setattr("regional_lv.criticism.posterior.MOST_ROUNDS", 12)
    model, best, easy = base
    posterior = sample(model, *laplace(model, best), 1000, 2)
    assert posterior.ess > easy.ess
    exact, mean, covariance = log_evidence(model)
    assert posterior.log_evidence == pytest.approx(exact, abs=4 * posterior.evidence_error + 0.02)
    found, sd = posterior.moments(posterior.x)
    assert torch.allclose(sd, covariance.diagonal().sqrt(), rtol=0.1)
    assert ((found - mean).abs() < 0.1 * sd).all()


def test_extension_and_its_evidence(base):
    _, best, _ = base

    class Flat(type(bias())):
        """The same change whatever theta is."""

        def mean(self, base, theta, psi, at_base=None):
            shift = psi[..., None] * self.pattern
            return shift.expand(*theta.shape[:-1], len(self.pattern))

    flat = Flat(bias().hypothesis, bias().pattern)
    extended = build([flat])
    fitted = fit_best(extended, extended.at_base(best.x))
    posterior = sample(extended, *laplace(extended, fitted), 1000, 2)
    exact, mean, covariance = log_evidence(extended)
    assert posterior.log_evidence == pytest.approx(exact, abs=4 * posterior.evidence_error + 0.02)
    # The fits' evidence leaves the prior's slope out: by (log theta's variance) / 2 of each.
    assert float(evidence_of_fit(extended, fitted)) == pytest.approx(exact, abs=0.1)
    none = torch.zeros(1, 1, dtype=torch.bool)
    at_base = fit(extended, extended.observations.y[None], extended.at_base(best.x), active=none)
    without = float(evidence_of_fit(extended, at_base, none))
    assert without == pytest.approx(log_evidence(build())[0], abs=0.1)
    psi, sd = posterior.moments(posterior.x[:, 10])
    assert float(psi) == pytest.approx(float(mean[10]), abs=0.15 * float(sd))
    assert float(sd) == pytest.approx(float(covariance[10, 10].sqrt()), rel=0.1)


@pytest.mark.parametrize("psi", [2.0, 2.2, 2.5, -2.5])
def test_evidence_of_a_fit_at_the_end_of_a_range(psi):
    """An effect as large as the range, or a quarter larger, against importance sampling."""
    emulator, extension = ToyEmulator(), bias()
    table = measured(emulator, extension, psi)
    o = observe({"a": table}, emulator, 1.0)
    model = Model(o, ExtendedEmulator(emulator, [extension]), Layout.inferred(("a",), PARAMETERS))
    start = torch.zeros(1, len(model.low)).double()
    fitted = fit_best(model, start)
    posterior = sample(model, *laplace(model, fitted), 1000, 2)
    assert float(evidence_of_fit(model, fitted)) == pytest.approx(posterior.log_evidence, abs=0.3)


def test_leaving_out_is_a_ratio_of_evidences(base):
    model, _, posterior = base
    left_out = leave_out(posterior, 1000, 3)
    whole = log_evidence(model)[0]
    for number, value in zip(left_out.folds, left_out.elpd.tolist(), strict=True):
        keep = ~model.observations.groups[number]
        assert value == pytest.approx(whole - log_evidence(model, keep)[0], abs=0.1), number


def test_what_is_left_out_is_predicted_by_the_rest(base):
    """Mean and sd of every channel in closed form."""
    model, _, posterior = base
    left_out = leave_out(posterior, 1000, 3)
    x0 = torch.zeros(1, len(model.low)).double()
    mean, slopes = (part[0, 0] for part in model.linearise(x0))
    noise = model.covariance(x0)[0, 0].diagonal()
    for number, group in model.observations.groups.items():
        _, centre, covariance = log_evidence(model, ~group)
        sd = (noise + (slopes @ covariance * slopes).sum(1)).sqrt()
        # As far as a few hundred effective draws tell them.
        gap = (left_out.mean[0] - mean - slopes @ centre)[group] / sd[group]
        assert gap.abs().max() < 0.15, number
        assert torch.allclose(left_out.sd[0][group], sd[group], rtol=0.1), number


def test_laplace_agrees_where_it_is_exact(base):
    model, best, posterior = base
    near = approximate(model, best, 500, 1)
    # The prior's slope, which it leaves out, is small against the data's.
    assert near.log_evidence == pytest.approx(posterior.log_evidence, abs=0.3)
    linear, sampled = leave_out_linearly(model, best), leave_out(posterior, 1000, 3)
    assert torch.allclose(linear.elpd, sampled.elpd, atol=0.3)
    assert torch.allclose(linear.sd, sampled.sd, rtol=0.15)


def test_errors_that_channels_share_predict_each_other(base):
    """With a covariance that is dense, as an emulator's is: what the others miss tells of these."""
    model, best, _ = base
    shared = 4.0 * unlisted_covariance(model.observations, ToyEmulator())
    dense = Model(model.observations, model.emulator, model.layout, discrepancy=shared)
    fitted = fit_best(dense, best.x)
    posterior = sample(dense, *laplace(dense, fitted), 1000, 2)
    linear, sampled = leave_out_linearly(dense, fitted), leave_out(posterior, 1000, 3)
    assert torch.allclose(linear.elpd, sampled.elpd, atol=0.3)
    assert torch.allclose(linear.sd, sampled.sd, rtol=0.15)
    # The prior's slope, which it leaves out, counts for the volume: strains say little of it.
    assert ((linear.mean - sampled.mean).abs() < 0.1 * sampled.sd)[:, 1:].all()
    # Without it, the sd of what is left out would be all of the covariance's.
    alone = dense.covariance(fitted.x)[0].diagonal(dim1=-2, dim2=-1).sqrt()
    assert (linear.sd < 0.8 * alone).any()


def test_errors_that_channels_of_a_fold_share_stay_shared_when_it_is_left_out(base):
    model, best, _ = base
    o = model.observations
    sd = model.noise_variance(best.x)[0, 0].sqrt()
    shared = torch.zeros_like(model.covariance(best.x)[0])
    for group in o.groups.values():
        shared += torch.outer(group * sd, group * sd)
    dense = Model(o, model.emulator, model.layout, discrepancy=9.0 * shared)
    fitted = fit_best(dense, best.x)
    posterior = sample(dense, *laplace(dense, fitted), 1000, 2)
    linear, sampled = leave_out_linearly(dense, fitted), leave_out(posterior, 1000, 3)
    largest = 0.0
    for (_, exact), (_, estimate) in zip(linear.joint, sampled.joint, strict=True):
        scale = exact.diagonal().sqrt().outer(exact.diagonal().sqrt())
        assert torch.allclose(exact / scale, estimate / scale, atol=0.1)
        largest = max(largest, float((exact / scale).fill_diagonal_(0.0).max()))
    assert largest > 0.5


def test_standard_error_of_the_gain_is_its_spread_over_measurements():
    """An effect of one size, measured again and again."""
    emulator, gains, errors = ToyEmulator(bend=0.0), [], []
    extension = bias()
    for seed in range(12):
        table = measured(emulator, extension, 0.15, seed=seed)
        o = observe({"a": table}, emulator, 1.0)
        layout = Layout.inferred(("a",), PARAMETERS)
        model = Model(o, ExtendedEmulator(emulator), layout)
        best = fit_from_nothing(model, 1)
        before = leave_out_linearly(model, best)
        extended = Model(o, ExtendedEmulator(emulator, [extension]), layout)
        fitted = fit_best(extended, extended.at_base(best.x))
        after = leave_out_linearly(extended, fitted)
        gain, error, _ = gain_of(before, after, approximate(extended, fitted, 300, 1))
        gains.append(gain)
        errors.append(error)
    spread_of_gains = torch.tensor(gains).std()
    assert 0.5 < torch.tensor(errors).mean() / spread_of_gains < 2.0


def test_the_same_seed_gives_the_same_draws(base):
    model, best, posterior = base
    again = sample(model, *laplace(model, best), 1000, 2)
    assert torch.equal(again.x, posterior.x)
    assert again.log_evidence == posterior.log_evidence


@pytest.fixture
def three():
    """Three hearts with a departure that no cause makes: the same one, or another one in each."""
    emulator = ToyEmulator(bend=0.0)

    def model(common: bool):
        rng, tables = np.random.default_rng(3), {}
        shape = np.linalg.cholesky(
            unlisted_pattern(observe({"a": measured(emulator)}, emulator, 1.0), emulator).numpy()
        )
        departures = [shape @ rng.standard_normal(52) for _ in range(3)]
        for i in range(3):
            table = measured(emulator, seed=i)
            table["value"] += 2 * departures[0 if common else i]
            tables[f"heart{i}"] = table
        o = observe(tables, emulator, 1.0)
        layout = Layout.known(THETA.expand(3, -1), PARAMETERS)
        return Model(o, ExtendedEmulator(emulator), layout)

    return model


def test_hearts_side_by_side_are_the_same_model(three):
    model = three(common=False)
    model.observations.present[1, 5] = False
    best = fit_from_nothing(model, 1)
    side_by_side = Together(model, torch.zeros(52, 52).double())
    found = fit_best(side_by_side, best.x)
    assert torch.allclose(found.x, best.x, atol=1e-6)
    evidence = evidence_of_fit(model, best), evidence_of_fit(side_by_side, found)
    assert torch.allclose(*evidence, atol=1e-6)
    common = torch.eye(52).double()
    covariance = Together(model, common).settle(best.x[0]).covariance(best.x)[0, 0]
    assert covariance.shape == (156, 156)
    assert covariance[3, 55] == 1 and covariance[3, 56] == 0 and covariance[5, 57] == 0


@pytest.mark.parametrize("common", [True, False])
def test_a_departure_that_hearts_share_is_told_from_one_of_each(three, common):
    model = three(common)
    best = fit_from_nothing(model, 1)
    size = 4 * unlisted_pattern(model.observations, ToyEmulator())
    of_each = 4 * unlisted_covariance(model.observations, ToyEmulator())
    rivals = (
        Together(model, size),
        Model(model.observations, model.emulator, model.layout, discrepancy=of_each),
    )
    together, apart = (float(evidence_of_fit(r, fit_best(r, best.x))[0]) for r in rivals)
    assert (together - apart > 20) == common and abs(together - apart) > 20


def test_a_volume_without_sd_does_not_cut_the_ends_of_the_posterior():
    """Among strains that leave theta wide: as wide as in closed form, in every direction."""
    emulator = ToyEmulator(bend=0.0)
    table = measured(emulator, strain=0.005)
    table.loc[table["quantity"] == "volume", "sd"] = math.nan
    exact = observe({"a": table}, emulator, 1.0)
    known = exact.blurred(emulator)
    assert known.noise.sd[0, 0] == BLUR * emulator.output_sd[0]
    assert torch.equal(known.noise.sd[:, 1:], exact.noise.sd[:, 1:])
    again = observe({"a": measured(emulator, strain=0.005)}, emulator, 1.0)
    assert torch.equal(again.blurred(emulator).noise.sd, again.noise.sd)
    settings = Settings(99, 0.05, 200, 1, 1, 4, 1)
    model = Critic(exact, emulator, [], [], settings, 1)._model(())
    posterior = sample(model, *laplace(model, fit_from_nothing(model, 1)), 1000, 2)
    _, _, covariance = log_evidence(model)
    _, sd = posterior.moments(posterior.x)
    assert torch.allclose(sd, covariance.diagonal().sqrt(), rtol=0.15)
