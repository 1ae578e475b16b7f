"""The verdict, on hearts that are linear in their inputs, and confirmation by a simulator that
differs from the emulator."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv.channels import Channels
from regional_lv.criticism.confirmation import LARGEST_ERROR, Round, Settings, plan
from regional_lv.criticism.left_out import left_out
from regional_lv.criticism.linear_model import LinearModel
from regional_lv.criticism.misfit import test as examine
from regional_lv.criticism.study import Concluded, criticise
from regional_lv.criticism.verdict import Examined, Verdict, at_bound, beyond_end
from regional_lv.inference import averaging
from regional_lv.inference.averaging import average
from regional_lv.inference.evidence import fit
from regional_lv.inference.observed import Observed
from regional_lv.inference.potential import Potential
from tests.criticism.linear_toys import Study, heart_inputs

CHANNELS = Channels.of()
CAUSES = [f"c{i}" for i in range(4)]


class Simulated:
    """The emulator of a study, and what its simulator has."""

    def __init__(self, emulator, names):
        self._emulator, self.simulated_names = emulator, names

    def __getattr__(self, name):
        return getattr(self._emulator, name)

    def simulated_at(self, x):
        return x


def truth(study, **values):
    return [values.get(name, 0.0) for name in study.inputs.names]


def judged(seed=2, confirmed="all", half=1.0, alike=None, outside=0.0, **values) -> Verdict:
    """Of a heart with some causes on; alike: a cause that does as another one does."""
    study = Study(heart_inputs((), 4, half), seed=seed)
    slopes = study.slopes
    if alike:
        one, other = (study.inputs.names.index(name) for name in alike)
        slopes[:, one] = slopes[:, other]
    y = study.data(truth(study, **values), 1, seed + 1)[0]
    y = y + outside * torch.linspace(-1, 1, len(y)).double().sin() * torch.tensor([1, -1] * 26)
    emulated = Simulated(study.emulator, study.inputs.names)
    potential = Potential(emulated, study.inputs, y, study.noise, None, Observed.one(CHANNELS))
    averaged = average(potential, 3, seed, draws=500)
    examined = {}
    for n in [averaged.base, *list(averaged.drawn)[:4]]:
        model = averaged.models[n]
        if n not in examined and model.fit is not None:
            linear = LinearModel.of(potential, model.fit)
            suspected = potential.suspected if n == averaged.base else ()
            tested = examine(linear, suspected, 99, seed)
            examined[n] = Examined(linear, tested, left_out(linear))
    known = None if confirmed is None else frozenset(examined if confirmed == "all" else ())
    return Verdict.of(averaged, dict(sorted(examined.items())), 0.05, known)


def test_effects_are_named():
    found = judged(c1=0.5, c2=-0.5)
    assert found.detected and found.explained and found.trusted
    assert sorted(found.named) == ["c1", "c2"] and not found.groups
    assert found.averaged.names[found.best] == "c1 + c2"


def test_nothing_is_named_where_nothing_is_detected():
    found = judged(seed=3)
    assert not found.detected and found.best is None and found.trusted
    assert not found.named and not found.groups and not found.proxies


def test_nothing_is_named_that_is_not_confirmed():
    found = judged(confirmed="none", c1=0.5)
    assert found.detected and found.best is None and not found.named
    # Without a simulator the best set is known, and told as suspected.
    found = judged(confirmed=None, c1=0.5)
    assert found.named == ["c1"] and found.confirmed is None


def test_a_set_that_simulations_bring_forward_is_simulated():
    """The emulator agrees after the first round, with which another set leads; and the budget."""
    right, wrong = judged(c1=0.5), judged(confirmed="none", c1=0.5)
    assert wrong.leads_unconfirmed and not right.leads_unconfirmed
    assert not judged(seed=3, confirmed="none").leads_unconfirmed

    class Critical:
        settings = SimpleNamespace(confirmation=Settings(3, 6, 3))

        def __init__(self, verdicts):
            self.verdicts, self.concluded = verdicts, []

        def plan(self, rounds):
            return pd.DataFrame({"set": [] if rounds else ["c2"]})

        def plan_of(self, averaged, number):
            return pd.DataFrame({"set": [averaged.names[0]]})

        def conclude(self, rounds, has_simulator):
            self.concluded.append(has_simulator)
            return Concluded(self.verdicts[len(rounds) - 1 if rounds else 0], {}, list(rounds))

    for verdicts, sets in (
        ([right], ["c2"]),
        ([wrong, right], ["c2", wrong.averaged.names[0]]),
        ([wrong, wrong, wrong], ["c2", *[wrong.averaged.names[0]] * 2]),
    ):
        found = criticise(Critical(verdicts), lambda rows: rows)
        assert [each["set"].item() for each in found.rounds] == sets
        assert found.verdict is verdicts[-1]
    critical = Critical([wrong])
    assert not criticise(critical, None).rounds and critical.concluded == [False]


def test_causes_that_do_the_same_are_a_group():
    found = judged(alike=("c2", "c1"), c1=0.5)
    assert not found.named and [sorted(group) for group in found.groups] == [["c1", "c2"]]


def test_no_stiffness_is_trusted_where_no_model_fits():
    found = judged(outside=1.5)
    assert found.detected and not found.trusted and not found.named


def test_an_estimate_at_the_end_of_its_range_is_not_named():
    found = judged(half=0.3, c1=0.9)
    assert "c1" not in found.named and found.proxies == ["c1"]


def test_how_far_beyond_the_end():
    """In one dimension: the free maximum in its own standard errors."""
    study = Study(heart_inputs((), 1), seed=1)
    k = study.inputs.names.index("c0")
    y = torch.tensor(truth(study, c0=1.5), dtype=torch.float64) @ study.slopes.mT
    potential = Potential(study.emulator, study.inputs, y, study.noise)
    x, zero = potential.nominal[None], torch.zeros(1).double()
    free = torch.zeros_like(potential.free([k]))[None]
    free[0, k] = True
    error = potential.settle(x, zero)
    fitted = fit(potential, free, zero, x, error, 60, 1e-9)
    assert float(fitted.x[0, k]) == pytest.approx(1.0)
    covariance = error[0] + torch.diag(study.noise.sd.square())
    column = study.slopes[:, k]
    sd = float(column @ torch.linalg.inv(covariance) @ column) ** -0.5
    assert beyond_end(potential, fitted, k) == pytest.approx(0.5 / sd, rel=1e-6)
    assert beyond_end(potential, replace(fitted, x=torch.zeros_like(fitted.x)), k) == 0.0


# ------------------------------------------------------------------------------- confirmation


def test_plan_simulates_the_leading_models_by_their_probability():
    found = judged(c1=0.5, c2=-0.2)
    settings = Settings(sets=2, simulations=10, rounds=1)
    table = plan(found.averaged, settings, 5)
    counts = table["set"].value_counts()
    leading = [found.averaged.names[n] for n in list(found.averaged.drawn)[:2]]
    assert set(counts.index) <= set(leading) and counts[leading[0]] == counts.max()
    assert 10 <= len(table) <= 12 and table["sample"].is_unique
    # Each row is a draw of its model: what is not free in it is at its nominal value.
    names = list(found.potential.inputs.names)
    for name, rows in table.groupby("set"):
        off = [c for c in CAUSES if c not in name.split(" + ")]
        assert (rows[off] == 0).all(axis=None) and rows[names[0]].nunique() == len(rows)
    pd.testing.assert_frame_equal(table, plan(found.averaged, settings, 5))


def test_where_no_model_is_probable_the_first_ones_lead(monkeypatch):
    """The data can leave two dozen, each with a few per cent."""
    monkeypatch.setattr(averaging, "LEAST_PROBABILITY", 1.1)
    found = judged(c1=0.5, c2=-0.2)
    assert found.averaged.leading == [*found.averaged.drawn]
    table = plan(found.averaged, Settings(sets=2, simulations=10, rounds=1), 5)
    assert {*table["set"]} == {*found.averaged.names[:2]}
    assert found.detected and found.trusted


def test_a_round_agrees_up_to_the_stated_error_or_the_noise():
    rng = np.random.default_rng(0)
    z, noise = rng.normal(size=(6, 52)), np.full(52, 0.01)
    made = pd.DataFrame({"set": ["a"] * 6})
    assert Round(made, 0, 0.01 * z, z).agrees(noise)
    assert not Round(made, 0, 0.01 * z, 2 * LARGEST_ERROR * z).agrees(noise)
    # Errors that are negligible beside the noise do not matter, whatever was stated of them.
    assert Round(made, 0, 0.001 * z, 5 * z).agrees(noise)
    nothing = np.empty((0, 52))
    assert not Round(made.iloc[:0], 3, nothing, nothing).agrees(noise)


def test_at_bound_of_draws(monkeypatch):
    found = judged(c1=0.5)
    (n,) = [n for n, name in enumerate(found.averaged.names) if name == "c1"]
    k = found.potential.inputs.names.index("c1")
    model = found.averaged.models[n]
    assert not at_bound(found.potential, model, k)
    x = model.drawn.x.clone()
    x[:, k] = found.potential.high[k]
    assert at_bound(found.potential, replace(model, drawn=replace(model.drawn, x=x)), k)
