"""Tests of misfit on hearts in closed form: calibrated, strong, and left out as a refit would."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy import stats

from regional_lv.channels import Channels
from regional_lv.criticism import linear_model, misfit
from regional_lv.criticism.identifiable import absorbed_inputs, identify
from regional_lv.criticism.left_out import gain, gains, left_out
from regional_lv.criticism.outliers import why_not
from regional_lv.criticism.patterns import contrasts, groups_of, hearts_of
from regional_lv.inference.noise import Noise
from regional_lv.inference.observed import Observed
from regional_lv.inputs.closed_forms import HeavyTails
from regional_lv.inputs.scales import Logarithmic
from tests.criticism.linear_toys import (
    FEW,
    HEART,
    NOISE,
    Study,
    heart_inputs,
    inferred_noise,
)
from tests.inference.toys import toy_inputs

STIFFNESS = np.linspace(-0.5, 0.5, 10)
FREE, OTHER = 12, 14
"""Places of suspected inputs: one that is on where a test says so, and another."""


def truth_of(inputs, stiffness=STIFFNESS, on=()):
    """All inputs at zero but the stiffness and those of `on`, (place, value)."""
    truth = np.zeros(len(inputs))
    truth[: len(stiffness)] = stiffness
    for at, value in on:
        truth[at] = value
    return truth


def p_values(study, truth, members, count, replicates):
    """Overall p-values (count,), and by family, of data sets drawn at the truth."""
    data = study.data(truth, count, 7)
    linear = study.model(data[0], members)  # the same about any fit
    found = [
        misfit.test(replace(linear, y=y), linear.doubted, replicates, seed)
        for seed, y in enumerate(data)
    ]
    families = {f: np.array([t.families[f] for t in found]) for f in found[0].families}
    return np.array([t.p_value for t in found]), families


def assert_uniform(p):
    assert stats.kstest(p, "uniform").pvalue > 0.005
    assert (p <= 0.05).sum() <= stats.binom.ppf(0.998, len(p), 0.05)


@pytest.mark.parametrize("on", [(), ((FREE, 0.6),)], ids=["as it is", "a cause that is on"])
def test_p_values_of_the_true_model_are_uniform(on):
    """Measured inputs vary from data set to data set; a cause that is on is free in the model."""
    study = Study(heart_inputs())
    members = tuple(at for at, _ in on)
    p, families = p_values(study, truth_of(study.inputs, on=on), members, 120, 119)
    assert_uniform(p)
    assert list(families) == "overall channel direction level wall cause pair".split()
    for of_family in families.values():
        assert_uniform(of_family)


def test_p_values_are_uniform_where_noise_is_inferred():
    study = Study(heart_inputs(), inferred_noise(FEW), Observed.one(FEW), error=0.005)
    truth = truth_of(study.inputs, on=[(FREE, 0.6)])
    p, families = p_values(study, truth, (FREE,), 60, 59)
    assert "overall" not in families
    for each in (p, *families.values()):
        assert_uniform(each)


def test_p_values_at_the_ends_of_ranges():
    """Four parameters at an end, or next to it: no more false alarms than stated."""
    study = Study(heart_inputs())
    stiffness = np.array([1.0, 1.0, 0.99, -1.0, *STIFFNESS[4:]])
    p, families = p_values(study, truth_of(study.inputs, stiffness), (), 120, 59)
    for each in (p, *families.values()):
        assert (each <= 0.05).sum() <= stats.binom.ppf(0.998, len(p), 0.05)
        assert 0.4 < each.mean() < 0.6


@pytest.mark.parametrize("inferred", [False, True], ids=["known noise", "inferred noise"])
def test_a_cause_is_detected_and_leads(inferred):
    """Six standard errors off; where noise is inferred, it has grown by a part of that."""
    study = Study(heart_inputs(), inferred_noise(Channels.of()) if inferred else None, error=0.005)
    linear = study.model(study.data(truth_of(study.inputs), 1, 3)[0])
    known = misfit.identify(linear, linear.fit(linear.y[None]), OTHER)
    effect = 6 * known.sd
    y = study.data(truth_of(study.inputs, on=[(OTHER, effect)]), 6, 3)
    found = [misfit.test(replace(linear, y=row), linear.doubted, 99, 1) for row in y]
    assert sum(t.p_value <= 0.05 for t in found) >= 5
    assert sum(t.causes[0].at == OTHER for t in found) >= 5
    lead = found[0].causes[0]
    assert lead.z > found[0].critical_z(0.05) and lead.p_value <= 0.05
    assert lead.p_single <= lead.p_value
    assert np.mean([t.causes[0].z for t in found]) == pytest.approx(4.2 if inferred else 6.0, abs=1)


def test_a_cause_counts_with_the_noise_that_it_leaves():
    """Without other errors, the likelihood ratio of one unknown scale: n log of the ratio of the
    sums of squares that are left, n the channels less the parameters."""
    channels = Channels.of(("radial", "circumferential"))
    noise = Noise(torch.zeros(34).double(), {"all": torch.full((34,), NOISE).double()}, 1e3)
    study = Study(heart_inputs((), half=50.0), noise, Observed.one(channels), error=1e-5)
    y = study.data(truth_of(study.inputs, on=[(OTHER, 0.1)]), 1, 3)[0]
    tested = misfit.test(study.model(y), (OTHER,), 19, 1)
    base, more = (study.slopes[:, [*range(10), *extra]].numpy() for extra in ([], [OTHER]))
    squares = [np.linalg.lstsq(j, y.numpy(), rcond=None)[1][0] for j in (base, more)]
    expected = 24 * np.log(squares[0] / squares[1])
    assert tested.causes[0].z ** 2 == pytest.approx(expected, rel=0.1)
    assert expected > 6


def test_scores_have_closed_forms():
    """With known noise and far ends: what one more parameter gains by generalised least squares."""
    study = Study(heart_inputs(half=50.0))
    linear = study.model(study.data(truth_of(study.inputs), 1, 5)[0])
    found = linear.fit(linear.y[None])
    z = misfit.score(found, linear.by_input[:, [FREE, OTHER]])
    spread = study.slopes[:, 16:] * study.sds[16:]
    covariance = study.emulator.error + NOISE**2 * torch.eye(52) + spread @ spread.T
    weight = torch.linalg.inv(covariance)

    def chi(columns):
        j = study.slopes[:, columns]
        estimate = torch.linalg.solve(j.T @ weight @ j, j.T @ weight @ linear.y)
        return float((linear.y - j @ estimate) @ weight @ (linear.y - j @ estimate))

    base = [*range(10)]
    alone = [chi(base) - chi([*base, at]) for at in (FREE, OTHER)]
    np.testing.assert_allclose(z[0].square(), alone, rtol=1e-4)
    assert float(found.deviance) == pytest.approx(chi(base), rel=1e-6)
    pair = misfit.pair_score(found, linear.by_input[:, [FREE, OTHER]], ["a", "b"])
    assert float(pair) ** 2 == pytest.approx(chi(base) - chi([*base, FREE, OTHER]), rel=1e-4)
    same = misfit.pair_score(found, linear.by_input[:, [FREE, OTHER]], ["a", "a"])
    assert float(same) == 0.0


def test_noise_scales_are_those_of_what_parameters_leave():
    """Without bias, but for the prior: parameters follow a part of the noise."""
    study = Study(heart_inputs(), inferred_noise(Channels.of()), error=1e-4)
    data = study.data(truth_of(study.inputs), 200, 9)
    found = study.model(data[0]).fit(data)
    np.testing.assert_allclose(found.log_sigma.mean(0), 0.0, atol=0.06)


def test_a_cause_goes_one_way_from_the_end_of_its_range():
    inputs = heart_inputs(ends=[("c2", 0.0, 1.0)])
    study = Study(inputs)
    y = study.data(truth_of(inputs, on=[(FREE, -0.3)]), 1, 3)[0]
    tested = {t.name: t.z for t in misfit.test(study.model(y), (FREE, OTHER), 19, 1).causes}
    assert tested["c2"] == 0.0 and tested["c4"] != 0.0


def test_what_parameters_absorb_is_not_identifiable():
    study = Study(heart_inputs())
    linear = study.model(study.data(truth_of(study.inputs), 1, 3)[0])
    by_input = linear.by_input.clone()
    by_input[:, FREE], by_input[:, OTHER] = -2 * by_input[:, 4], 0.0
    linear = replace(linear, by_input=by_input)
    tested = misfit.test(linear, linear.doubted, 19, 1)
    known = {t.name: t.identified for t in tested.causes}
    assert not known["c2"].identifiable and known["c2"].absorbed > 0.99
    assert "a change of t4 (correlation 1.000)" in known["c2"].why
    assert not known["c4"].identifiable and "none of the channels" in known["c4"].why
    assert known["c1"].identifiable and 0 < known["c1"].absorbed < 1
    assert {t.name for t in tested.causes[-2:]} == {"c2", "c4"}
    assert all(t.p_value == t.p_single == 1.0 for t in tested.causes[-2:])


def test_what_parameters_leave_of_a_strong_effect_is_searched():
    study = Study(heart_inputs())
    linear = study.model(study.data(truth_of(study.inputs), 1, 3)[0])
    by_input = linear.by_input.clone()
    by_input[:, FREE] += 100 * by_input[:, 4]
    by_input[:, OTHER] = by_input[:, 4]
    linear = replace(linear, by_input=by_input)
    strong, like = (identify(linear, linear.fit(linear.y[None]), k) for k in (FREE, OTHER))
    assert min(strong.absorbed, like.absorbed) > 0.98
    assert strong.identifiable and not like.identifiable
    assert absorbed_inputs(linear) == [OTHER]


def test_what_data_know_of_an_input_is_in_its_unit():
    """A coordinate may be a logarithm: its sd is a share of the value."""
    study = Study(heart_inputs())
    linear = study.model(study.data(truth_of(study.inputs), 1, 3)[0])
    found, place = linear.fit(linear.y[None]), study.inputs.names.index("c1")
    plain = identify(linear, found, place)
    x = linear.x.clone()
    x[place] = math.log(8.0)
    linear.inputs[place].scale = Logarithmic()
    assert identify(replace(linear, x=x), found, place).sd == pytest.approx(8.0 * plain.sd)
    assert plain.identifiable


def test_departures_show_in_their_family():
    study = Study(heart_inputs())
    pattern = contrasts(HEART.channels)["wall"]["septal radial"]
    y = study.data(truth_of(study.inputs), 1, 3)[0] + pattern
    linear = study.model(y)
    tested = misfit.test(linear, (), 199, 1)
    assert tested.p_value <= 0.02 and not tested.causes and tested.critical_z(0.05) == 0.0
    first = next(one for one in tested.largest if one["family"] == "wall")
    assert first["what"] == "septal radial" and first["z"] > 3 and first["p_value"] <= 0.02
    assert tested.largest[0]["family"] == "overall"
    assert len(left_out(linear).channels(["somebody"])) == len(HEART.names)


def test_heavy_tails():
    """Few wild channels are seen by the test for tails."""
    inputs = toy_inputs(10, (), 2)
    tails = HeavyTails({"observables": {"quantities": ["volume"]}})
    members = [*inputs, tails]
    roles = dict(zip(inputs.names, inputs.roles, strict=True)) | {
        tails.name: type(inputs.roles[0])("suspected")
    }
    study = Study(type(inputs)({}, members, roles), error=0.005)
    y = study.data(truth_of(study.inputs), 1, 3)[0]
    y[[5, 20, 33, 48]] += torch.tensor([1.5, -2.0, 1.8, -1.4])
    tested = misfit.test(study.model(y), (10, 12), 99, 1)
    assert tested.causes[0].name == "heavy_tails" and tested.causes[0].p_value <= 0.02
    assert "tails" in tested.families
    model = study.model(y, (12,))  # with them, wild channels count little
    assert float(model.noise.sd[5]) > 2 * float(model.noise.sd[6])
    assert not bool(model.free[12])


def test_few_channels_are_not_tested():
    channels = Channels.parse(["volume_ml", "circumferential_01", "radial_07", "radial_08"])
    study = Study(heart_inputs(), observed=Observed.one(channels))
    linear = study.model(study.data(truth_of(study.inputs), 1, 3)[0])
    tested = misfit.test(linear, linear.doubted, 19, 1)
    assert math.isnan(tested.p_value) and tested.families == {} and tested.largest == []
    assert all(t.p_value == 1.0 for t in tested.causes)
    assert np.isfinite(left_out(linear).sd.numpy()).all()


# --------------------------------------------------------------------------------- left out


def test_left_out_is_what_a_refit_without_the_segment_predicts():
    """Against generalised least squares without the segment's channels, and the normal density of
    what these are given the others."""
    study = Study(heart_inputs(half=50.0))
    linear = study.model(study.data(truth_of(study.inputs), 1, 5)[0])
    found = left_out(linear)
    spread = study.slopes[:, 16:] * study.sds[16:]
    covariance = study.emulator.error + NOISE**2 * torch.eye(52) + spread @ spread.T
    j, y = study.slopes[:, :10], linear.y
    for row, at in enumerate(groups_of(HEART)):
        rest = torch.tensor([i for i in range(52) if i not in at.tolist()])
        weight = torch.linalg.inv(covariance[rest][:, rest])
        posterior = torch.linalg.inv(j[rest].T @ weight @ j[rest])
        x = posterior @ j[rest].T @ weight @ y[rest]
        across = covariance[at][:, rest] @ weight
        mean = j[at] @ x + across @ (y[rest] - j[rest] @ x)
        moved = j[at] - across @ j[rest]
        own = covariance[at][:, at] - across @ covariance[rest][:, at]
        own = own + moved @ posterior @ moved.T
        np.testing.assert_allclose(found.mean[at], mean, atol=1e-4)
        np.testing.assert_allclose(found.sd[at], own.diagonal().sqrt(), rtol=1e-3)
        density = torch.distributions.MultivariateNormal(mean, own).log_prob(y[at])
        assert float(found.elpd[row]) == pytest.approx(float(density), abs=1e-2)


def test_groups_are_left_out_as_many_at_a_time_as_fit_into_memory(monkeypatch):
    """Of two dozen hearts all at once are twenty gigabytes."""
    study = Study(heart_inputs(), inferred_noise(Channels.of()), error=0.005)
    linear = study.model(study.data(truth_of(study.inputs), 1, 2)[0])
    together, fitted = left_out(linear), []
    fit = type(linear).fit
    monkeypatch.setattr(
        type(linear), "fit", lambda self, y, keep: fitted.append(len(y)) or fit(self, y, keep)
    )
    monkeypatch.setattr(linear_model, "NUMBERS", 4 * len(linear.y) ** 2)
    apart = left_out(linear)
    assert len(fitted) > 2 and max(fitted) == 4
    for name in ("mean", "sd", "elpd"):
        torch.testing.assert_close(getattr(apart, name), getattr(together, name))


def test_intervals_of_what_was_left_out_cover():
    study = Study(heart_inputs(), inferred_noise(Channels.of()), error=0.005)
    data = study.data(truth_of(study.inputs), 30, 2)
    linear = study.model(data[0])
    coverage = [left_out(replace(linear, y=y)).coverage for y in data]
    assert np.mean(coverage) == pytest.approx(0.95, abs=0.02)


def test_the_right_model_gains():
    study = Study(heart_inputs())
    y = study.data(truth_of(study.inputs, on=[(FREE, 0.6)]), 1, 3)[0]
    before, right, wrong = (left_out(study.model(y, m)) for m in ((), (FREE,), (OTHER,)))
    elpd, error = gain(before, right)
    assert elpd > 2 * error > 0 and gain(before, wrong)[0] < elpd
    found = gains(before, right)
    assert found["elpd"] == elpd and found["rmse_after"] < found["rmse_before"]
    assert found["coverage_before"] < 0.8 and found["coverage_after"] > 0.85
    assert gains(before, None)["elpd"] is None
    rows = right.channels(["somebody"])
    assert [row["output"] for row in rows] == list(HEART.names)
    assert rows[3]["z"] == pytest.approx(
        (rows[3]["observed"] - rows[3]["predicted"]) / rows[3]["sd"]
    )


# ------------------------------------------------------------------------- channels, outliers


def twice(channels) -> Observed:
    """Two hearts with the same channels."""
    heart = np.repeat([0, 1], len(channels))
    return Observed((*channels.names, *channels.names), (*channels, *channels), heart)


def test_groups_are_of_one_heart():
    channels = Channels.of(("volume", "radial", "torsion"), load_fractions=(0.5,))
    both = twice(channels)
    groups = groups_of(both)
    assert len(groups) == 2 * (17 + 4)
    assert torch.cat(groups).sort().values.tolist() == [*range(2 * len(channels))]
    assert [both.names[i] for i in groups[1]] == ["radial_01", "radial_01@0.5"]
    assert [s.stop for s in hearts_of(both)] == [len(channels), 2 * len(channels)]
    radial = contrasts(both.channels)["direction"]["radial"]
    assert int(radial.sum()) == 4 * 17


def test_hearts_err_independently():
    """Blocks by heart, with one unknown scale that both have."""
    few = Channels.of(("radial",))
    both = twice(few)
    noise = Noise(torch.zeros(34).double(), {"radial": torch.full((34,), NOISE).double()}, 10.0)
    study = Study(toy_inputs(3, (), 1), noise, both)
    apart = torch.kron(torch.eye(2), torch.ones(17, 17)).double()
    study.emulator.error = study.emulator.error * apart
    linear = study.model(study.data(np.zeros(4), 1, 3)[0])
    found = linear.fit(linear.y[None])
    whole = linear.error[0] + torch.diag(noise.variance(found.log_sigma[0]))
    np.testing.assert_allclose(found.precision[0] @ whole, np.eye(34), atol=1e-8)
    assert misfit.test(linear, (3,), 99, 1).p_value > 0.01


@pytest.mark.parametrize(
    ("off", "reason"),
    [
        ({"radial_03": 5.0, "circumferential_10": -4.0}, ""),
        ({"volume_ml": 5.0}, "all of the volume is off"),
        ({"radial_03": 5.0, "circumferential_03": -2.5}, "radial_03 and circumferential_03"),
        ({"radial_03": 5.0, "radial_09": 2.5}, "radial_03 and radial_09"),
        ({"radial_03": 5.0, "radial_08": 2.5}, ""),  # of one wall, but not below each other
        ({f"radial_{s:02d}": 4.0 for s in (1, 3, 5, 10, 13)}, "are radial and above"),
        ({f"radial_{s:02d}": 4.0 for s in range(1, 10)}, "too many"),
    ],
)
def test_outliers_stand_alone(off, reason):
    z = torch.tensor([off.get(name, 0.5) for name in HEART.names])
    found = why_not(z, HEART)
    assert reason in found and bool(reason) == bool(found)
