"""Likelihood-ratio tests on a heart in closed form whose noise is inferred."""

from dataclasses import replace

import pytest
import torch

from regional_lv.criticism import ratio, score
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.fit import fit_from_nothing
from regional_lv.criticism.model import Layout, Model
from regional_lv.criticism.observations import observe
from tests.criticism.toy import PARAMETERS, Bent, ToyEmulator, basal, bias, measured


@pytest.fixture
def causes(monkeypatch):
    monkeypatch.setattr(ratio, "REPLICATES", 79)
    bent = Bent(basal().hypothesis, basal().pattern)
    return [bent, bias()]


def p_values(causes, psi):
    emulator = ToyEmulator()
    table = measured(emulator, causes[0], psi, seed=5, known=False)
    observations = observe({"heart": table}, emulator, 1.0)
    layout = Layout.inferred(("heart",), PARAMETERS)
    model = Model(observations, ExtendedEmulator(emulator.select(observations.outputs)), layout)
    best = fit_from_nothing(model, 1)
    return model, best, ratio.likelihood_ratios(model, best, causes, 2)


def test_a_cause_that_a_score_overlooks_is_found_when_fitted(causes):
    model, best, found = p_values(causes, psi=1.0)
    seen = score.statistics(model, best, causes).causes[0]
    null = score.bootstrap(model, best, causes, 79, 3).causes
    assert found["basal_motion"] <= 0.05 < found["radial_scale"]
    by_score = score.share_beyond(float(seen[0].abs()), null.abs().amax(1))
    assert by_score > found["basal_motion"]


def test_nothing_is_found_where_nothing_is(causes):
    assert min(p_values(causes, psi=0.0)[2].values()) > 0.05


def test_a_secant_sees_what_the_beginning_of_an_effect_does_not(causes):
    """`signature_at` takes the direction from there, so that a score is enough."""
    model, best, _ = p_values(causes, psi=1.0)
    bent = causes[0]
    secant = Bent(replace(bent.hypothesis, signature_at=1.0), bent.pattern)
    at_base, along = score.statistics(model, best, [bent, secant]).causes[0].abs()
    assert along > 1.5 * at_base
    theta = model.theta(best.x)
    one = torch.ones(theta.shape[:-1], dtype=theta.dtype)
    assert torch.allclose(model.signature(secant, best.x), secant.mean(None, theta, one))
