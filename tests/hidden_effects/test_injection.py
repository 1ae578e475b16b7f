"""Hearts of the benchmark: who gets which causes, how large, and what is written of them."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from regional_lv.errors import InputError
from regional_lv.hidden_effects import injection
from regional_lv.hidden_effects.discrepancies import DISCREPANCIES
from regional_lv.hidden_effects.groups import EFFECTS
from regional_lv.hidden_effects.injection import (
    Injection,
    PlannedHeart,
    draw_values,
    inject,
    plan_hearts,
)
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.measured.synthetic import unit_noise
from regional_lv.simulation.ventricles import Ventricles

ROLES = {
    "segment_thickness": {"role": "measured", "sd_mm": 1.0},
    "septal_load": "suspected",
    "basal_motion": "suspected",
    "fibre_rotation": "suspected",
    "focal_scar": "suspected",
    "mixed_frames": "suspected",
    "heavy_tails": "suspected",
}
PHYSICAL = ("septal_load", "basal_motion", "fibre_rotation", "focal_scar", "mixed_frames")
COUNTS = {"singles": 60, "pairs": 30, "triples": 20, "unlisted": 25, "nulls": 60, "misread": 40}
NOISE = {"strain": 0.01, "volume": 1.0}


@pytest.fixture(scope="module")
def physics(smoke_config):
    return sections_of(smoke_config | {"inputs": ROLES})


@pytest.fixture(scope="module")
def inputs(physics):
    return Inputs.from_config(physics)


@pytest.fixture(scope="module")
def hearts(inputs):
    return plan_hearts(COUNTS, inputs, 5)


def drawn(hearts, inputs, seed=0):
    rng = np.random.default_rng(seed)
    return np.array([draw_values(heart, inputs, rng) for heart in hearts])


def test_every_cause_has_its_turn_and_the_order_tells_nothing(hearts, inputs):
    assert Counter(heart.group for heart in hearts) == COUNTS
    singles = Counter(heart.causes[0] for heart in hearts if heart.group == "singles")
    assert singles == dict.fromkeys((*PHYSICAL, "heavy_tails"), 10)
    for heart in hearts:
        if heart.group != "unlisted":
            assert len(set(heart.causes)) == EFFECTS[heart.group] and not heart.left_out
        # What changes the noise stands alone.
        assert "heavy_tails" not in heart.causes or heart.group == "singles"
    ways = Counter(heart.discrepancy for heart in hearts if heart.group == "unlisted")
    assert ways == dict.fromkeys((*DISCREPANCIES, "left_out"), 5)
    scar = next(h for h in hearts if h.discrepancy == "left_out" and h.causes == ("focal_scar",))
    assert scar.left_out == tuple(f"focal_scar_{s}" for s in range(1, 18))
    nulls = np.flatnonzero([heart.group == "nulls" for heart in hearts])
    assert nulls.min() < 20 and nulls.max() > len(hearts) - 20
    assert plan_hearts(COUNTS, inputs, 5) == hearts != plan_hearts(COUNTS, inputs, 6)


def test_values_come_from_what_the_roles_say(hearts, inputs):
    x = drawn(hearts, inputs)
    suspected = inputs.of_role("suspected")
    for heart, values in zip(hearts, x, strict=True):
        on = {inputs[k].cause for k in np.flatnonzero(suspected & (values != inputs.nominal))}
        assert on == set(heart.causes)
    scale = inputs.coordinates.scaled
    nominal, low, high = (scale(v) for v in (inputs.nominal, inputs.lower, inputs.upper))
    away = scale(x) - nominal
    share = (away / np.where(away < 0, nominal - low, high - nominal).clip(1e-9))[:, suspected]
    share = np.abs(share[share != 0])
    uniform = stats.uniform(injection.LEAST_SHARE, 1 - injection.LEAST_SHARE)
    assert stats.kstest(share, uniform.cdf).pvalue > 0.01
    stiffness = x[:, inputs.of_role("inferred")].ravel()
    assert stats.kstest(stiffness, stats.uniform(0.5, 1.5).cdf).pvalue > 0.01
    read = [heart.group != "misread" for heart in hearts]
    off = (x - inputs.nominal)[:, inputs.of_role("measured")]
    assert off[read].std() == pytest.approx(1.0, rel=0.05)


def test_a_misread_table_is_wrong_in_all_segments(inputs):
    """Of the radii, too, which this study holds fixed."""
    whole = injection.with_table(inputs)
    heart = PlannedHeart("a", "misread", (), "", (), 1)
    values = drawn([heart] * 100, whole)
    for stem, sd in (("wall_thickness_", 0.1), ("endo_radius_", 0.03)):
        of_stem = [name.startswith(stem) for name in whole.names]
        own = values[:, of_stem] / whole.nominal[of_stem]
        assert own.shape[1] == 17 and own.mean() == pytest.approx(1.0, abs=0.01)
        assert own.std() == pytest.approx(sd, rel=0.08)
    assert "C_a_septal" in whole.names
    assert all(whole[whole.names.index(e.name)] is e for e in inputs)  # with the study's ranges
    null = drawn([replace(heart, group="nulls")] * 3, whole)
    radii = [name.startswith("endo_radius") for name in whole.names]
    assert (null[:, radii] == whole.nominal[radii]).all()


def test_heavy_tails_have_outliers():
    rng = np.random.default_rng(0)
    heavy, plain = (unit_noise(tails, 20000, rng) for tails in (0.4, 0.0))
    # Of Student's t with 2.5 degrees of freedom 4.1 % lie beyond 4 scales; of a Gaussian none.
    assert np.mean(np.abs(heavy) > 4) == pytest.approx(0.041, abs=0.006)
    assert np.abs(plain).max() < 5 and plain.std() == pytest.approx(1.0, abs=0.03)


class Formula(Ventricles):
    """Outputs that are known, in place of simulated ones; some ventricles cannot be inflated."""

    def __init__(self, inputs, fails=lambda values: False):
        super().__init__(None, inputs)
        self.fails = fails

    def altered(self, inputs):
        return Formula(inputs, self.fails)

    def outputs(self, x):
        values = dict(zip(self.inputs.names, x, strict=True))
        if self.fails(values):
            raise ArithmeticError("too soft")
        return np.full(len(self.channels), values["C_a_septal"])


@pytest.fixture
def no_mesh(monkeypatch):
    monkeypatch.setattr("regional_lv.simulation.ventricles.read_mesh", lambda path: path)


@pytest.mark.usefixtures("no_mesh")
def test_subjects_and_truth_lie_apart(hearts, inputs):
    some = [heart for heart in hearts if heart.discrepancy in ("", "left_out", "smooth_bias")][:80]
    subjects, truth = inject(Injection(Formula(inputs), NOISE), some, "test")
    assert subjects["subject"].tolist() == truth["subject"].tolist()
    assert set(subjects) - {"subject", "left_out"} == {
        name for c in Formula(inputs).channels.names for name in (c, f"sd_{c}")
    }
    strains = [c.name for c in Formula(inputs).channels if c.kind.is_strain]
    septal = np.array([json.loads(values)["C_a_septal"] for values in truth["values"]])
    ordinary = ~truth["causes"].str.contains("heavy") & (truth["unlisted"] != "smooth_bias")
    errors = (subjects[strains].to_numpy() - septal[:, None])[ordinary]
    assert errors.std() == pytest.approx(0.01, rel=0.05)
    # The noise of each heart is its own.
    assert np.abs(np.corrcoef(errors)[0, 1:]).max() < 0.7
    biased = truth["unlisted"] == "smooth_bias"
    for row, quantity in zip(subjects[biased].index, truth.loc[biased, "detail"], strict=True):
        error = subjects.loc[row, strains].astype(float) - septal[row]
        own = error[[name.startswith(quantity) for name in strains]]
        assert np.sqrt((own**2).mean()) > 1.5 * error.drop(own.index).std()
    left_out = truth.set_index("subject")["unlisted"] == "left_out"
    assert (subjects.set_index("subject")["left_out"] != "").eq(left_out).all()


@pytest.mark.usefixtures("no_mesh")
def test_what_cannot_be_inflated_is_drawn_again(hearts, inputs):
    nulls = [heart for heart in hearts if heart.group == "nulls"][:20]
    soft = Formula(inputs, lambda values: values["C_a_septal"] < 0.8)
    _, truth = inject(Injection(soft, NOISE), nulls, "test")
    assert truth["status"].eq("converged").all()
    assert min(json.loads(values)["C_a_septal"] for values in truth["values"]) >= 0.8
    subjects, truth = inject(Injection(Formula(inputs, lambda values: True), NOISE), nulls, "test")
    assert subjects.empty and "sd_volume_ml" in subjects
    assert truth["reason"].eq("too soft").all() and isinstance(truth, pd.DataFrame)


def test_groups_that_do_not_fit_the_study_are_refused(smoke_config):
    few = sections_of(smoke_config | {"inputs": {k: "suspected" for k in ("septal_load",)}})
    none = dict.fromkeys(COUNTS, 0)
    with pytest.raises(InputError, match=r"hearts\.pairs: .* 2 of the causes.* which are 1"):
        plan_hearts(none | {"pairs": 1}, Inputs.from_config(few), 1)
    kept = sections_of(smoke_config | {"inputs": {"septal_load": "suspected"}})
    inputs = Inputs.from_config(kept)
    of_mesh = Inputs({**inputs.base, "geometry": {"wall_thickness_scale": 1.0}}, inputs)
    with pytest.raises(InputError, match=r"hearts\.misread: .* not made from a segment table"):
        plan_hearts(none | {"misread": 1}, of_mesh, 1)
