"""Hidden effects: who gets which, how large, and what noise comes with it."""

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from regional_lv.criticism import injection
from regional_lv.criticism.hypotheses import REGISTRY
from regional_lv.errors import InputError
from regional_lv.parameters import Parameterisation
from regional_lv.physics import physics_of
from tests.criticism.toy import OUTPUTS, PARAMETERS

HEARTS = {"singles": 10 * len(REGISTRY), "pairs": 30, "triples": 20, "unlisted": 23, "nulls": 60}


@pytest.fixture(scope="module")
def entries():
    return injection.random_subjects(HEARTS, 5, REGISTRY, PARAMETERS)


def test_every_hypothesis_is_injected_and_some_have_none(entries):
    singles = [next(iter(e["effects"])) for e in entries if e["kind"] == "singles"]
    assert all(singles.count(name) == 10 for name in REGISTRY)
    kinds = [e["kind"] for e in entries]
    assert {kind: kinds.count(kind) for kind in HEARTS} == HEARTS
    for entry in entries:
        assert len(entry["effects"]) == injection.KINDS[entry["kind"]]
        # What changes the noise stands alone, or has no pair.
        assert "heavy_tails" not in entry["effects"] or entry["kind"] == "singles"
        hidden = list(entry["effects"]) if entry["kind"] == "unlisted" else [""]
        assert [entry["withheld"]] == hidden
    # The order tells nothing: subjects without effect are not together.
    places = np.flatnonzero([kind == "nulls" for kind in kinds])
    assert places.min() < 20 and places.max() > len(kinds) - 20


def test_sizes_are_in_the_range_and_away_from_the_base(entries):
    shares = []
    for entry in entries:
        for effect in injection.read_effects(entry["effects"]):
            h = effect.hypothesis
            assert h.low <= effect.value <= h.high
            end = h.low if effect.value < h.base else h.high
            value, base, end = (h.scale(v) for v in (effect.value, h.base, end))
            shares.append((value - base) / (end - base))
            assert effect.component in h.components
    assert min(shares) >= injection.LEAST_SHARE - 1e-12
    assert np.mean(shares) == pytest.approx((1 + injection.LEAST_SHARE) / 2, abs=0.06)


@pytest.mark.parametrize(("bounds", "least"), [((0.1, 5.0), 0.5), ((0.8, 5.0), 0.8)])
def test_theta_is_log_uniform_where_it_is_physiological(bounds, least):
    parameters = Parameterisation(bounds=bounds)
    entries = injection.random_subjects({"nulls": 50}, 5, REGISTRY, parameters)
    theta = np.array([list(e["theta"].values()) for e in entries])
    assert len(np.unique(theta)) == 500
    for part in (theta[:, ::2], theta[:, 1::2], theta[:25], theta[25:]):
        uniform = stats.loguniform(least, 2.0).cdf
        assert stats.kstest(part.ravel(), uniform).pvalue > 0.01


def test_subjects_follow_the_seed(entries):
    again = injection.random_subjects(HEARTS, 5, REGISTRY, PARAMETERS)
    other = injection.random_subjects(HEARTS, 6, REGISTRY, PARAMETERS)
    assert again == entries
    assert other[0]["theta"] != entries[0]["theta"] and other[0]["seed"] != entries[0]["seed"]


def test_heavy_tails_have_outliers():
    rng = np.random.default_rng(0)
    heavy = injection.unit_noise(injection.read_effects({"heavy_tails": 0.4}), 20000, rng)
    plain = injection.unit_noise(injection.read_effects({"fibre_rotation": 5.0}), 20000, rng)
    # Of Student's t with 2.5 degrees of freedom 4.1 % lie beyond 4 scales; of a Gaussian none.
    assert np.mean(np.abs(heavy) > 4) == pytest.approx(0.041, abs=0.006)
    assert np.abs(plain).max() < 5 and plain.std() == pytest.approx(1.0, abs=0.03)


def test_a_batch_keeps_subjects_and_truth_apart(monkeypatch, tmp_path, smoke_config):
    """One cannot be inflated: it is in the truth, with the reason, and nowhere else."""
    physics, counts = physics_of(smoke_config), {"singles": 20, "pairs": 10, "nulls": 10}
    causes = injection.asked("all", physics)
    every = injection.random_subjects(counts, 5, causes, PARAMETERS)
    entries = every[10:20]
    failing = entries[3]["theta"]["C_a_septal"]

    def outputs(self, theta, effects):
        if theta[6] == failing:
            raise ArithmeticError("too soft")
        return np.zeros(52)

    monkeypatch.setattr(injection.Ventricles, "outputs", outputs)
    files = tmp_path / "subjects.parquet", tmp_path / "truth.parquet"
    benchmark = {"hearts": counts, "noise": {"strain": 0.01, "volume": 1.0}}
    asked = None, physics, PARAMETERS, "all", benchmark, 5, "0001", 10
    injection.inject_batch(*asked, *files)
    subjects, truth = map(pd.read_parquet, files)
    assert list(subjects) == ["subject", "withheld", *OUTPUTS, *(f"sd_{o}" for o in OUTPUTS)]
    assert truth["subject"].tolist() == [f"subject-{i:04d}" for i in range(10, 20)]
    assert truth.loc[3, "status"] == "failed" and truth.loc[3, "reason"] == "too soft"
    assert "subject-0013" not in set(subjects["subject"]) and len(subjects) == 9
    for entry, row in zip(entries, truth.itertuples(), strict=True):
        assert list(json.loads(row.effects)) == list(entry["effects"])
    ordinary = ["heavy" not in t for t in truth.drop(3)["effects"]]
    noise_seen = subjects.loc[ordinary, list(OUTPUTS[1:])].to_numpy()
    assert noise_seen.std() == pytest.approx(0.01, rel=0.15)
    assert isinstance(subjects, pd.DataFrame) and subjects["sd_volume_ml"].eq(1.0).all()


def test_a_shift_is_what_one_effect_does_beside_the_others():
    """Two that multiply, one on the noise, and a ventricle that cannot be inflated."""
    effects = injection.read_effects(
        {"septal_load": 3.0, "wall_thickness": 0.5, "heavy_tails": 0.3}
    )

    class Product:
        def outputs(self, theta, effects):
            return theta * np.prod([e.value for e in effects])

    theta = np.array([1.0, 2.0])
    found = injection.shifts(Product(), theta, effects, 0.45 * theta)
    assert list(found) == ["septal_load", "wall_thickness"]
    np.testing.assert_allclose(found["septal_load"], 0.45 * theta - 0.15 * theta)
    np.testing.assert_allclose(found["wall_thickness"], 0.45 * theta - 0.9 * theta)

    class Thick(Product):
        def outputs(self, theta, effects):
            if "wall_thickness" not in {e.hypothesis.name for e in effects}:
                raise ArithmeticError("too soft")
            return super().outputs(theta, effects)

    assert injection.shifts(Thick(), theta, effects, 0.45 * theta)["wall_thickness"] is None


def test_hearts_with_more_effects_than_causes_are_refused():
    catalogue = {name: REGISTRY[name] for name in ("septal_load", "heavy_tails")}
    singles = injection.random_subjects(
        {"singles": 5, "nulls": 1}, 1, catalogue, Parameterisation()
    )
    assert sum(len(entry["effects"]) for entry in singles) == 5
    with pytest.raises(InputError, match=r"hearts\.pairs: .* 2 of the causes.* which are 1"):
        injection.random_subjects({"pairs": 1}, 1, catalogue, Parameterisation())


def test_a_set_that_cannot_be_inflated_is_given_up():
    """After two failures; a set of which one converged goes on, and so does another subject's."""
    sets = {"soft": [0, 0, 0, 0], "mixed": [1, 0, 0, 0, 1]}
    rows = [
        {"set": name, "draw": draw, "subject": "a", "C_a": float(good), "effects": "{}"}
        for name, draws in sets.items()
        for draw, good in enumerate(draws)
    ]
    design = pd.DataFrame([*rows, rows[0] | {"subject": "b"}])
    asked_for = []

    class Some:
        channels = SimpleNamespace(names=("volume_ml",))

        def linearised(self, theta, effects):
            asked_for.append(theta[0])
            if not theta[0]:
                raise ArithmeticError("too soft")
            return np.array([100.0]), np.array([[-7.0]])

    made = injection.simulate_design(design, Some(), {}, ["C_a"])
    assert made["reason"].tolist() == (
        ["too soft"] * 2
        + ["not simulated: the first 2 of this set failed"] * 2
        + ["", "too soft", "too soft", "too soft", "", "too soft"]
    )
    assert len(asked_for) == 8
    for column in ("volume_ml", "slope_volume_ml"):
        assert made[column].notna().tolist() == [not reason for reason in made["reason"]]
