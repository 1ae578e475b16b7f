"""Ventricles with a known fault: simulated in full with it, measured with noise, truth apart."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.channels import Channel, Channels
from regional_lv.criticism.hypotheses import REGISTRY, Hypothesis, asked
from regional_lv.criticism.hypotheses.base import with_value
from regional_lv.measured import synthetic_subject
from regional_lv.mechanics.continuation import Runner
from regional_lv.parameters import Parameterisation
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

    Attributes: `channels`, those of the study.
    """

    def __init__(self, mesh: str | Path, physics: Mapping, predictor: str | Path):
        self._files, self._physics = (mesh, predictor), physics
        self._base: Runner | None = None
        self.channels = Channels.from_config(physics)

    def outputs(self, theta: np.ndarray, effects: list[Effect]) -> np.ndarray:
        """The channels' values (D,), without noise, at `theta` (P,).

        Raises ArithmeticError, with the reason, for a ventricle that cannot be inflated.
        """
        physics, seen = self._physics, list(self.channels)
        for effect in effects:
            h = effect.hypothesis
            physics = h.extend(physics, effect.value, effect.component)
            seen = [Channel(c.quantity, c.place, h.load_fraction(c, effect.value)) for c in seen]
        frames = sorted({c.load_fraction for c in seen} - {1.0})
        if frames != sorted(physics["loading"]["frames"]):
            physics = with_value(physics, ("loading", "frames"), frames)
        runner = self._runner(physics)
        result = runner.run(theta)
        if result.status != "converged":
            raise ArithmeticError(result.reason)
        at = {name: i for i, name in enumerate(runner.channels.names)}
        return result.observables[[at[channel.name] for channel in seen]]

    def _runner(self, physics: Mapping) -> Runner:
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
    injected: int,
    null: int,
    seed: int,
    hypotheses: Mapping[str, Hypothesis],
    parameters: Parameterisation,
) -> list[dict]:
    """Entries as in `synthetic_subjects` (`theta`, `effects`, `seed`) with a name, `subject`.

    injected: how many have one effect, each hypothesis in turn after a shuffle, its value uniform
    in the plausible range but for what is close to the base (`LEAST_SHARE`); null: how many have
    none.
    Theta is log-uniform in `PHYSIOLOGICAL`, as far as its bounds allow. Their order tells nothing.
    """
    rng = np.random.default_rng(derive(seed, "benchmark"))
    low = np.log(np.maximum(PHYSIOLOGICAL[0], parameters.lower))
    high = np.log(np.minimum(PHYSIOLOGICAL[1], parameters.upper))
    names = [
        name for _ in range(-(-injected // len(hypotheses))) for name in _shuffled(hypotheses, rng)
    ]
    effects = [_random_effect(hypotheses[name], rng) for name in names[:injected]] + [{}] * null
    entries = []
    for number, place in enumerate(rng.permutation(injected + null)):
        theta = np.exp(rng.uniform(low, high))
        entries.append(
            {
                "subject": f"subject-{number:04d}",
                "theta": dict(zip(parameters.names, theta.tolist(), strict=True)),
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


def inject_batch(
    mesh: str | Path,
    predictor: str | Path,
    physics: Mapping,
    parameters: Parameterisation,
    hypotheses: str | list[str],
    benchmark: Mapping,
    seed: int,
    batch: str,
    batch_size: int,
    subjects: str | Path,
    truth: str | Path,
) -> None:
    """Simulate and measure one batch of `random_subjects`; write the subjects and the truth.

    hypotheses: names, or `all`, as in the configuration; benchmark: its section
    `criticism.benchmark`; seed: the study's. Subjects (Parquet): `subject`, the D outputs with
    noise, their `sd_<output>`. Truth, which no inference reads: `subject`, theta, `effect` (empty
    if none), `component`, `value`, `status` and `reason`; a ventricle that cannot be inflated is in
    the truth alone.
    """
    catalogue = asked(hypotheses, physics)
    counts = benchmark["injected"], benchmark["null"]
    entries = random_subjects(*counts, seed, catalogue, parameters)
    first = int(batch) * batch_size
    ventricles = Ventricles(mesh, physics, predictor)
    tables = _injected(
        ventricles,
        entries[first : first + batch_size],
        benchmark["noise"],
        f"hidden effects batch {batch}",
    )
    for table, path in zip(tables, (subjects, truth), strict=True):
        table.to_parquet(path, index=False)


def _injected(
    ventricles: Ventricles, entries: list[dict], noise: Mapping[str, float], name: str
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Subjects and truth of some entries, as `inject_batch` writes them."""
    channels = ventricles.channels
    progress, subjects, truths = Progress(name, len(entries)), [], []
    for entry in entries:
        effects = read_effects(entry["effects"])
        theta = np.array([*entry["theta"].values()])
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
            unit = unit_noise(effects, len(channels), rng)
            table = synthetic_subject(outputs, channels, noise, unit).set_index("output")
            row = {"subject": entry["subject"]} | table["value"].to_dict()
            subjects.append(row | table["sd"].add_prefix("sd_").to_dict())
        truths.append(truth)
        progress.step(failed=truth["status"] == "failed")
    return pd.DataFrame(subjects), pd.DataFrame(truths)
