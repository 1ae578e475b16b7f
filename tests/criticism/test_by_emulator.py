"""Criticism by an emulator of the stiffness alone, as in studies of tables, of a heart whose
strains follow from a formula."""

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
from regional_lv.measured.tables import write_measured
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


@pytest.fixture(scope="module")
def trained():
    """Emulators of the formula by name, learnt from simulations between two factors."""

    def trained(name="exact_gp", low=0.1, high=5.0):
        theta = sobol(ROWS, np.full(len(FACTORS), low), np.full(len(FACTORS), high), "log", 1)
        outputs = formula(theta)
        return emulators.create(name).fit(
            theta, outputs, parameters=FACTORS, outputs=CHANNELS.names, seed=0
        )

    return trained


@pytest.fixture
def critic(tmp_path):
    """Of a heart with `quantities` measured, and an emulator."""

    def critic(emulator, *quantities, noise=0.01, volume_noise=1.0):
        rng = np.random.default_rng(0)
        truth = formula(rng.uniform(0.8, 1.6, (1, len(FACTORS))))[0]
        sd = np.where([c.quantity == "volume" for c in CHANNELS], volume_noise, noise)
        rows = pd.DataFrame(
            {
                "output": CHANNELS.names,
                "quantity": [c.quantity for c in CHANNELS],
                "place": [c.place for c in CHANNELS],
                "segment": [c.segment for c in CHANNELS],
                "load_fraction": [c.load_fraction for c in CHANNELS],
                "value": truth + sd * rng.normal(size=len(truth)),
                "sd": sd,
            }
        )
        kept = rows["quantity"].isin(quantities) if quantities else slice(None)
        file = tmp_path / "measured.csv"
        write_measured(rows[kept], file)
        physics, settings = sections_of_stiffness(STUDY), settings_of(STUDY)
        return critic_of(emulator, "heart", ["heart"], [file], physics, settings, seed=1)

    return critic


def limits(critic) -> str:
    return "\n".join(criticise(critic, None).findings["limits"])


def test_a_posterior_beyond_the_simulations_is_said_to_be(trained, critic):
    assert "no simulation is near" not in limits(critic(trained()))
    narrow = limits(critic(trained(low=0.9, high=1.1)))
    assert "% of the posterior lies where no simulation is near" in narrow


@pytest.mark.parametrize("name", ["exact_gp", "local_gp"])
def test_what_was_not_measured_is_said_by_every_emulator(trained, critic, name):
    """Also by those that train anew for what was measured alone."""
    said = limits(critic(trained(name), "circumferential", "volume"))
    assert "no radial strain was measured" in said and "no longitudinal strain" in said


def test_emulators_are_judged_by_the_noise_that_the_measurement_states(trained, critic):
    emulator = trained()
    for noise, volume_noise in ((0.03, 5.0), (0.002, 0.4)):
        known = critic(emulator, noise=noise, volume_noise=volume_noise)._noise_sd
        assert sorted(set(known.round(9))) == [noise, volume_noise]


def test_calibrated_errors_reach_the_posterior(trained, critic):
    emulator = trained()
    judged = critic(emulator)
    potential = judged.potential(emulator)
    assert emulator.jacobian_factor > 1
    x = potential.nominal[None]
    error = potential.observed.dense(potential.settle(x, x.new_zeros(1)))
    theta = potential.inputs.coordinates.natural(x)
    stated = emulator.predict(theta).covariance
    np.testing.assert_allclose(error, emulator.jacobian_factor * stated, rtol=1e-6)


def test_the_same_answer_from_every_seed(trained, critic):
    """The fits that it rests on end at their maximum."""
    found = []
    for seed in range(3):
        one = critic(trained(), "circumferential", "volume")
        one.seed = seed
        found.append(criticise(one, None).findings["base_probability"])
    assert np.ptp(found) < 0.1


def test_models_are_examined_until_one_passes(trained, critic, monkeypatch):
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
