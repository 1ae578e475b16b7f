"""Ventricles with a known fault: simulated in full with it, measured with noise, truth apart."""

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.criticism.hypotheses import REGISTRY, Hypothesis
from regional_lv.mechanics.continuation import Runner
from regional_lv.progress import Progress
from regional_lv.seeds import derive
from regional_lv.simulations import make_runner

log = logging.getLogger(__name__)

PHYSIOLOGICAL = (0.5, 2.0)
"""Where benchmark subjects have their scaling factors, evenly in the logarithm."""

LEAST_SHARE = 0.2
"""Effects of benchmark subjects are at least this share of the way from base to end of range."""


@dataclass(frozen=True)
class Effect:
    """One hypothesis that is true: its value, in its component."""

    hypothesis: Hypothesis
    value: float
    component: str = ""


def read_effects(effects: dict) -> list[Effect]:
    """The `effects` of a `synthetic_subjects` entry."""
    found = []
    for name, value in effects.items():
        at = (value,)
        if isinstance(value, dict):
            at = (value["multiplier"], str(value["segment"]))
        found.append(Effect(REGISTRY[name], *at))
    return found


class Ventricles:
    """Simulates ventricles with effects, each by the full simulator.

    Parameters
    ----------
    mesh, physics, predictor: the study's.
    """

    def __init__(self, mesh: Path, physics: dict, predictor: Path):
        self._files, self._physics = (mesh, predictor), physics
        self._base: Runner | None = None

    def outputs(self, theta: np.ndarray, effects: list[Effect]) -> np.ndarray:
        """The 52 outputs (without noise) at `theta` (10,).

        Raises ArithmeticError, with the reason, for a ventricle that cannot be inflated.
        """
        physics, fraction = self._physics, 1.0
        for effect in effects:
            physics = effect.hypothesis.extend(physics, effect.value, effect.component)
            fraction *= effect.hypothesis.strain_fraction(effect.value)
        if fraction < 1:
            physics = physics | {"loading": physics["loading"] | {"frames": [fraction]}}
        result = self._runner(physics).run(theta)
        if result.status != "converged":
            raise ArithmeticError(result.reason)
        outputs = result.observables
        if fraction < 1:
            if fraction not in result.frames:
                raise ArithmeticError(f"no state at {fraction:g} of the pressure")
            early = result.frames[fraction]
            outputs = np.where([name == "volume_ml" for name in aha.OUTPUTS], outputs, early)
        for effect in effects:
            outputs = effect.hypothesis.measure(outputs, aha.OUTPUTS, effect.value)
        return outputs

    def _runner(self, physics: dict) -> Runner:
        mesh, predictor = self._files
        if physics is not self._physics:
            return make_runner(mesh, physics, predictor)
        if self._base is None:
            self._base = make_runner(mesh, physics, predictor)
        return self._base


def unit_noise(effects: list[Effect], size: int, rng: np.random.Generator) -> np.ndarray:
    """Noise (size,) of unit scale, Gaussian unless an effect has another."""
    for effect in effects:
        noise = effect.hypothesis.noise(size, effect.value, rng)
        if noise is not None:
            return noise
    return rng.standard_normal(size)


# ---------------------------------------------------------------------------------- benchmark


def random_subjects(
    planted: int,
    null: int,
    seed: int,
    hypotheses: dict[str, Hypothesis],
    bounds: tuple[float, float],
) -> list[dict]:
    """Entries as in `synthetic_subjects` (`theta`, `effects`, `seed`) with a name, `subject`.

    planted: how many have one effect, each hypothesis in turn after a shuffle, its value uniform in
    the plausible range but for what is close to the base (`LEAST_SHARE`); null: how many have none.
    Theta is log-uniform in `PHYSIOLOGICAL`, as far as `bounds` allow. Their order tells nothing.
    """
    rng = np.random.default_rng(derive(seed, "benchmark"))
    low, high = max(PHYSIOLOGICAL[0], bounds[0]), min(PHYSIOLOGICAL[1], bounds[1])
    names = [
        name for _ in range(-(-planted // len(hypotheses))) for name in _shuffled(hypotheses, rng)
    ]
    effects = [_random_effect(hypotheses[name], rng) for name in names[:planted]] + [{}] * null
    entries = []
    for number, place in enumerate(rng.permutation(planted + null)):
        theta = np.exp(rng.uniform(np.log(low), np.log(high), len(aha.PARAMETERS)))
        entries.append(
            {
                "subject": f"subject-{number:04d}",
                "theta": dict(zip(aha.PARAMETERS, theta.tolist(), strict=True)),
                "effects": effects[place],
                "seed": derive(seed, "benchmark", number),
            }
        )
    return entries


def _shuffled(names, rng) -> list[str]:
    return [str(name) for name in rng.permutation(list(names))]


def _random_effect(hypothesis: Hypothesis, rng: np.random.Generator) -> dict:
    base, low, high = hypothesis.base, hypothesis.low, hypothesis.high
    below, above = base - low, high - base
    side = low if rng.uniform() < below / (below + above) else high
    value = float(base + rng.uniform(LEAST_SHARE, 1.0) * (side - base))
    if hypothesis.components == ("",):
        return {hypothesis.name: value}
    segment = int(rng.choice(hypothesis.components))
    return {hypothesis.name: {"segment": segment, "multiplier": value}}


def plant_batch(
    mesh: Path, physics: dict, predictor: Path, entries: list[dict], noise: dict, name: str
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Simulate and measure entries of `random_subjects`; return the subjects and the truth.

    Subjects: `subject`, the 52 outputs with noise, their `sd_<output>`. Truth, for a file that no
    inference reads: `subject`, theta, `effect` (empty if none), `component`, `value`, `status` and
    `reason`; a ventricle that cannot be inflated is in the truth alone.
    """
    ventricles = Ventricles(mesh, physics, predictor)
    sd = np.array([noise["volume" if o == "volume_ml" else "strain"] for o in aha.OUTPUTS])
    progress, subjects, truths = Progress(name, len(entries)), [], []
    for entry in entries:
        effects = read_effects(entry["effects"])
        theta = np.array([entry["theta"][parameter] for parameter in aha.PARAMETERS])
        truth = {"subject": entry["subject"]} | entry["theta"]
        truth |= {
            "effect": "",
            "component": "",
            "value": np.nan,
            "status": "converged",
            "reason": "",
        }
        for effect in effects:
            truth |= {"effect": effect.hypothesis.name, "component": effect.component}
            truth["value"] = effect.value
        try:
            outputs = ventricles.outputs(theta, effects)
        except ArithmeticError as error:
            truth |= {"status": "failed", "reason": str(error)}
            log.warning("%s: %s failed: %s", name, entry["subject"], error)
        else:
            rng = np.random.default_rng(entry["seed"])
            values = outputs + sd * unit_noise(effects, len(sd), rng)
            row = {"subject": entry["subject"]} | dict(zip(aha.OUTPUTS, values, strict=True))
            subjects.append(row | {f"sd_{o}": s for o, s in zip(aha.OUTPUTS, sd, strict=True)})
        truths.append(truth)
        progress.step(failed=truth["status"] == "failed")
    return pd.DataFrame(subjects), pd.DataFrame(truths)
