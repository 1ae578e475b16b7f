"""Fits and score tests on a heart in closed form."""

import numpy as np
import pytest
import torch
from scipy import stats

from regional_lv.criticism import score
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.fit import fit, fit_from_nothing
from regional_lv.criticism.identify import identify
from regional_lv.criticism.model import Layout, Model
from regional_lv.criticism.observations import observe
from tests.criticism.toy import (
    PARAMETERS,
    THETA,
    Extension,
    Hypothesis,
    Pressure,
    ToyEmulator,
    basal,
    bias,
    catalogue,
    measured,
    pattern,
)


def model_of(table, emulator=None, extensions=()):
    emulator = emulator or ToyEmulator()
    observations = observe({"a": table}, emulator, 1.0)
    chosen = emulator.select(observations.outputs)
    layout = Layout.inferred(("a",), PARAMETERS)
    return Model(observations, ExtendedEmulator(chosen, extensions), layout)


@pytest.fixture(scope="module")
def null():
    return model_of(measured(ToyEmulator(), seed=3))


def test_fit_finds_theta_without_noise():
    model = model_of(measured(ToyEmulator(), strain=1e-6))
    found = fit_from_nothing(model, 1)
    assert torch.allclose(model.theta(found.x)[0, 0], THETA, rtol=1e-3)


def test_fit_without_a_segment_ignores_it(null):
    keep = torch.tensor([not name.endswith("_07") for name in null.observations.outputs])
    best = fit_from_nothing(null, 1)
    changed = torch.where(keep, null.observations.y, null.observations.y + 5.0)
    ends = [
        fit(null, y[None], best.x, keep.expand(1, 1, -1)).x for y in (null.observations.y, changed)
    ]
    assert torch.allclose(*ends, atol=1e-6)
    assert not torch.allclose(ends[0], best.x, atol=1e-3)


def test_noise_that_is_inferred_is_found():
    """Below the truth, as maxima are: ten parameters follow a part of it."""
    errors = []
    for seed in range(4):
        model = model_of(measured(ToyEmulator(), seed=seed, known=False))
        sigma = fit_from_nothing(model, 1).x[0, model.first_sigma :].exp()
        errors.append((sigma * model.observations.noise.units.amax(1)).log() - np.log(0.01))
    mean = torch.stack(errors).mean(0)
    assert (mean > -0.8).all() and (mean < 0.2).all()


def test_deviance_is_chi_squared(null):
    best = fit_from_nothing(null, 1)
    y = torch.cat(
        [model_of(measured(ToyEmulator(), seed=s)).observations.y[None] for s in range(100, 160)]
    )
    found = fit(null, y, best.x.repeat(60, 1))
    p = stats.kstest(found.deviance.numpy(), stats.chi2(52 - 10).cdf).pvalue
    assert p > 0.01


def test_scores_are_standard_normal_under_the_model(null):
    best = fit_from_nothing(null, 1)
    sampled = score.bootstrap(null, best, [bias(), basal()], 400, 5)
    assert sampled.causes[:, 0].std() == pytest.approx(1.0, abs=0.12)
    # One-sided: half of the mass sits at zero.
    assert (sampled.causes[:, 1] == 0).double().mean() == pytest.approx(0.5, abs=0.1)


def test_p_values_of_null_subjects_are_uniform():
    """Of the misfit and over the catalogue: 40 hearts with nothing wrong, each at its own theta."""
    emulator, rng = ToyEmulator(), np.random.default_rng(1)
    extensions, found = catalogue(), []
    for seed in range(40):
        theta = torch.as_tensor(rng.uniform(0.5, 2.5, 10))
        model = model_of(measured(emulator, seed=seed, theta=theta))
        best = fit_from_nothing(model, seed)
        observed = score.statistics(model, best, extensions)
        sampled = score.bootstrap(model, best, extensions, 79, seed)
        extreme = float(observed.causes.abs().max())
        found.append(
            (
                score.judge_misfit(observed, sampled).p_value,
                score.share_beyond(extreme, sampled.causes.abs().amax(1)),
            )
        )
    for p in np.transpose(found):
        assert stats.kstest(p, "uniform").pvalue > 0.01
        assert (p <= 0.05).sum() <= stats.binom.ppf(0.995, 40, 0.05)


def test_misfit_shows_in_its_direction():
    table = measured(ToyEmulator(), bias(), 0.5, seed=2)
    model = model_of(table)
    best = fit_from_nothing(model, 1)
    observed = score.statistics(model, best, [])
    misfit = score.judge_misfit(observed, score.bootstrap(model, best, [], 199, 1))
    assert misfit.p_value <= 0.02
    largest = max((x for x in misfit.largest if x[0] == "direction"), key=lambda x: abs(x[2]))
    assert largest[1] == "radial" and largest[2] > 0


def test_a_cause_of_several_places_makes_no_pair():
    """A catalogue of one cause: nothing that has no spread enters the p-value."""
    model = model_of(measured(ToyEmulator(), seed=3))
    best = fit_from_nothing(model, 1)
    places = [e for e in catalogue() if e.hypothesis.name == "focal_scar"]
    observed = score.statistics(model, best, places)
    null = score.bootstrap(model, best, places, 199, 1)
    misfit = score.judge_misfit(observed, null)
    assert "pair" not in misfit.families
    assert misfit.p_value > 0.05


def test_heavy_tails_show():
    rng = np.random.default_rng(0)
    gaussian = score.tail_score(torch.as_tensor(rng.standard_normal((200, 50))))
    student = score.tail_score(torch.as_tensor(rng.standard_t(3, (200, 50))))
    assert student.median() > gaussian.quantile(0.95)


def test_a_pair_scores_what_neither_cause_does():
    """Two effects of which each hides the other: the fit with both says what they gain."""
    o = model_of(measured(ToyEmulator(), seed=4))
    best = fit_from_nothing(o, 1)
    projected = score.Projected.of(best, o)
    extensions = [bias(), basal()]
    patterns = [score.pattern_of(o, e, best.x) for e in extensions]
    pair = score.pair_score(projected, patterns, ["a", "b"])
    together = torch.cat(patterns, dim=-1)[0]
    slope = together.T @ projected.residual[0]
    chi = slope @ torch.linalg.solve(together.T @ projected.precision[0] @ together, slope)
    assert float(pair) == pytest.approx(float(chi.sqrt()), rel=1e-9)
    assert float(pair) >= float(projected.score(together).abs().max())
    assert float(score.pair_score(projected, patterns, ["a", "a"])) == 0.0


def test_left_out_residuals_match_refits(null):
    """The linear form against fits without the segment, where the model is linear."""
    model = model_of(measured(ToyEmulator(bend=0.0), seed=4), ToyEmulator(bend=0.0))
    best = fit_from_nothing(model, 1)
    projected = score.Projected.of(best, model)
    at = torch.tensor([i for i, o in enumerate(model.observations.outputs) if o.endswith("_07")])
    error, sd = projected.left_out([at])
    keep = torch.ones(52, dtype=torch.bool)
    keep[at] = False
    refitted = fit(model, model.observations.y[None], best.x, keep.expand(1, 1, -1))
    assert torch.allclose(error[0, at], refitted.residual[0, 0, at], atol=2e-3)
    assert (sd[0, at] > 0.01).all()


def test_pressure_hides_in_global_stiffness(null):
    best = fit_from_nothing(null, 1)
    found = identify(null, best, Pressure())
    assert not found.identifiable
    assert found.absorbed > 0.99
    assert "C_a of all zones together" in found.why


def test_effect_on_channels_that_were_not_measured(null):
    table = measured(ToyEmulator())
    model = model_of(table[table["quantity"] != "longitudinal"])
    extension = Extension(
        Hypothesis("lengthening", 0.0, -1.0, 1.0), pattern("longitudinal", range(1, 18), 0.1)
    ).select(model.observations.outputs)
    best = fit_from_nothing(model, 1)
    found = identify(model, best, extension)
    assert not found.identifiable
    assert "none of the channels" in found.why


def test_few_channels_are_tested_for_what_they_support():
    table = measured(ToyEmulator())
    table = table[(table["quantity"] == "volume") | (table["segment"].isin([1, 4, 6]))]
    table = table[table["quantity"].isin(["volume", "circumferential"])]
    model = model_of(table)
    best = fit_from_nothing(model, 1)
    observed = score.statistics(model, best, [bias().select(model.observations.outputs)])
    assert observed.tails is None
    assert "wall" not in observed.misfit
    assert torch.isfinite(observed.causes).all()


def test_a_listed_cause_need_not_stand_out_among_departures_of_any_kind():
    """Seven kinds of departure as large as they are by chance; one cause beyond 98 % of its own."""
    rng = np.random.default_rng(3)
    replicates = torch.as_tensor(np.abs(rng.standard_normal((399, 8))))

    def drawn(rows: torch.Tensor) -> score.Statistics:
        misfit = {f"family {i}": rows[:, i : i + 1] for i in range(7)}
        names = {family: ("one",) for family in misfit}
        return score.Statistics(misfit, names, rows[:, 7:], torch.zeros(len(rows)), None)

    observed = replicates.quantile(0.8, dim=0)[None].clone()
    observed[:, 7] = replicates[:, 7].quantile(0.985)
    found = score.judge_misfit(drawn(observed), drawn(replicates))
    assert found.families["cause"] < 0.02
    assert found.p_value < 0.05
    # All kinds together are still tested: one of them that is far off.
    observed[:, 7], observed[:, 0] = 0.0, 6.0
    assert score.judge_misfit(drawn(observed), drawn(replicates)).p_value < 0.01
