"""Criticism by an emulator of the stiffness alone, as in studies of tables, of a heart whose
strains follow from a formula."""

import functools
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from regional_lv import config, emulators
from regional_lv.channels import Channels
from regional_lv.criticism.settings import settings_of
from regional_lv.criticism.study import Verdict, critic_of, criticise
from regional_lv.inputs.space import sections_of_stiffness
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured import synthetic_subject, write_measured
from regional_lv.simulation.sobol import sobol

STUDY = config.load({"study": "formula", "inputs": {}, "criticism": {"bootstrap": 99}})
FACTORS, CHANNELS = StiffnessInputs.from_config(STUDY), Channels.from_config(STUDY)
ROWS = 120


# By quantity: the middle, and what a factor that is e times as large takes from it.
MIDDLE = {"volume": 150.0, "circumferential": -0.15, "longitudinal": -0.13, "radial": 0.4}
CHANGE = {"volume": 20.0, "circumferential": -0.03, "longitudinal": -0.03, "radial": 0.08}


def formula(theta: np.ndarray) -> np.ndarray:
    """Outputs (N, D) at theta (N, P): what stiffens a zone takes from its own segments first."""
    near = [[not c.segment or c.segment in factor.segments for factor in FACTORS] for c in CHANNELS]
    first = [factor.factor == "C_a" for factor in FACTORS]
    spread = 1 + 0.2 * np.random.default_rng(0).normal(size=(len(CHANNELS), len(FACTORS)))
    slopes = np.where(near, 1.0, 0.15) * np.where(first, 1.0, 0.6) * spread
    middle, change = ([by[c.quantity] for c in CHANNELS] for by in (MIDDLE, CHANGE))
    stiffer = np.log(theta) @ slopes.T
    return middle - np.array(change) * (stiffer + 0.15 * np.sin(stiffer))


@functools.cache
def trained(name="exact_gp", low=0.1, high=5.0):
    """An emulator of the formula, learnt from simulations between two factors."""
    theta = sobol(ROWS, np.full(len(FACTORS), low), np.full(len(FACTORS), high), "log", 1)
    return emulators.create(name).fit(
        theta, formula(theta), parameters=FACTORS, outputs=CHANNELS.names, seed=0
    )


@pytest.fixture
def critic(tmp_path):
    """Of some hearts with `quantities` measured, and an emulator."""

    def critic(emulator, *quantities, noise=0.01, volume_noise=1.0, hearts=("anna",), known=()):
        files, scales = [], {"strain": noise, "volume": volume_noise}
        for number, heart in enumerate(hearts):
            rng = np.random.default_rng(number)
            outputs = formula(rng.uniform(0.8, 1.6, (1, len(FACTORS))))[0]
            unit = rng.normal(size=len(CHANNELS))
            table = synthetic_subject(outputs, CHANNELS, scales, unit)
            kept = table["quantity"].isin(quantities) if quantities else slice(None)
            files.append(tmp_path / f"{heart}.csv")
            write_measured(table[kept], files[-1])
        physics, settings = sections_of_stiffness(STUDY), settings_of(STUDY)
        return critic_of(emulator, "all", hearts, files, physics, settings, 1, known)

    return critic


def limits(critic) -> str:
    return "\n".join(criticise(critic, None).findings["limits"])


def test_a_posterior_beyond_the_simulations_is_said_to_be(critic):
    assert "no simulation is near" not in limits(critic(trained()))
    narrow = limits(critic(trained(low=0.9, high=1.1)))
    assert "% of the posterior lies where no simulation is near" in narrow


@pytest.mark.parametrize("how", ["inferred", "known"])
def test_hearts_together_are_looked_up_each_by_itself(critic, tmp_path, how):
    """Whose stiffness is inferred, or known but for common factors."""
    hearts = ("anna", "bert")
    theta = tmp_path / "theta.csv"
    pd.DataFrame(1.2, hearts, FACTORS.names).rename_axis("subject").to_csv(theta)
    given = {"hearts": hearts, "known": [theta] if how == "known" else ()}
    assert "no simulation is near" not in limits(critic(trained(), **given))
    assert "no simulation is near" in limits(critic(trained(low=0.9, high=1.1), **given))


@pytest.mark.parametrize("name", ["exact_gp", "local_gp"])
def test_what_was_not_measured_is_said_by_every_emulator(critic, name):
    """Also by those that train anew for what was measured alone."""
    said = limits(critic(trained(name), "circumferential", "volume"))
    assert "no radial strain was measured" in said and "no longitudinal strain" in said


def test_emulators_are_judged_by_the_noise_that_the_measurement_states(critic):
    emulator = trained()
    for noise, volume_noise in ((0.03, 5.0), (0.002, 0.4)):
        known = critic(emulator, noise=noise, volume_noise=volume_noise)._noise_sd
        assert sorted(set(known.round(9))) == [noise, volume_noise]


def test_calibrated_errors_reach_the_posterior(critic):
    emulator = trained()
    judged = critic(emulator)
    potential = judged.potential(emulator)
    assert emulator.jacobian_factor > 1
    x = potential.nominal[None]
    error = potential.observed.dense(potential.settle(x, x.new_zeros(1)))
    theta = potential.inputs.coordinates.natural(x)
    stated = emulator.predict(theta).covariance
    np.testing.assert_allclose(error, emulator.jacobian_factor * stated, rtol=1e-6)


def test_the_same_answer_from_every_seed(critic):
    """The fits that it rests on end at their maximum."""
    found = []
    for seed in range(3):
        one = critic(trained(), "circumferential", "volume")
        one.seed = seed
        found.append(criticise(one, None).findings["base_probability"])
    assert np.ptp(found) < 0.1


def test_models_are_examined_until_one_passes(critic, monkeypatch):
    """A model as it is that misses at the level of the test is none that passes."""
    judged = critic(trained())
    base, leading = 3, [0, 1, 2, 4, 5, 6]
    averaged = SimpleNamespace(
        drawn=dict.fromkeys([base, *leading]),
        base=base,
        leading=leading,
        models={n: SimpleNamespace(members=() if n == base else (n,)) for n in [base, *leading]},
    )
    p_values = dict.fromkeys(leading, 0.001) | {base: 0.03, 5: 0.5}
    monkeypatch.setattr(
        judged,
        "_examined",
        lambda averaged, n: SimpleNamespace(
            linear=SimpleNamespace(testable=True),
            tested=SimpleNamespace(p_value=p_values[n]),
            fits=lambda size: p_values[n] > 0.02,
        ),
    )
    examined = judged._examine(averaged)
    assert list(examined) == [0, 1, 2, 3, 4, 5]
    assert Verdict(averaged, examined, 0.05, None).trusted
