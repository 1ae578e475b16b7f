"""Ventricles with a known fault: simulated in full with it, measured with noise, truth apart."""

import json
import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.channels import Channel, Channels
from regional_lv.criticism.designs import slope_of
from regional_lv.criticism.hypotheses import REGISTRY, Hypothesis, NoiseHypothesis, asked
from regional_lv.criticism.hypotheses.base import configured, psi_and_component, with_value
from regional_lv.errors import InputError
from regional_lv.measured import synthetic_subject
from regional_lv.mechanics.continuation import Effort, Runner, Solver
from regional_lv.mechanics.dolfinx_api import release_unused
from regional_lv.parameters import Parameterisation
from regional_lv.progress import Progress
from regional_lv.seeds import derive
from regional_lv.simulations import make_runner, make_simulator

log = logging.getLogger(__name__)

PHYSIOLOGICAL = (0.5, 2.0)
"""Where benchmark subjects have their scaling factors, evenly in the logarithm."""

HOPELESS = 2
"""Simulations of a set that fail before any converged, after which it is given up."""

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
    return [Effect(REGISTRY[name], *psi_and_component(at)) for name, at in effects.items()]


class Ventricles:
    """Simulates ventricles with effects, each by the full simulator.

    Parameters
    ----------
    mesh, physics: the study's, or another mesh of the same ventricle.
    predictor: of that mesh; None inflates every ventricle from the reference state.

    Attributes: `channels`, those of the study.
    """

    def __init__(self, mesh: str | Path, physics: Mapping, predictor: str | Path | None = None):
        self._mesh, self._predictor, self._physics = mesh, predictor, physics
        self._base: Runner | None = None
        self.channels = Channels.from_config(physics)

    def outputs(self, theta: np.ndarray, effects: list[Effect]) -> np.ndarray:
        """The channels' values (D,), without noise, at `theta` (P,).

        Raises ArithmeticError, with the reason, for a ventricle that cannot be inflated.
        """
        return self.linearised(theta, effects)[0]

    def linearised(
        self, theta: np.ndarray, effects: list[Effect]
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """The same and their derivatives about log theta (D, P); None without a predictor."""
        physics, seen = self._physics, list(self.channels)
        for effect in effects:
            h = effect.hypothesis
            physics = h.extend(physics, effect.value, effect.component)
            seen = [Channel(c.quantity, c.place, h.load_fraction(c, effect.value)) for c in seen]
        frames = sorted({c.load_fraction for c in seen} - {1.0})
        if frames != sorted(physics["loading"]["frames"]):
            physics = with_value(physics, ("loading", "frames"), frames)
        try:
            names, values, slopes = self._simulated(physics, theta)
        finally:
            if physics is not self._physics:
                release_unused()
        at = {name: i for i, name in enumerate(names)}
        rows = [at[channel.name] for channel in seen]
        return values[rows], None if slopes is None else slopes[rows]

    def _simulated(
        self, physics: Mapping, theta: np.ndarray
    ) -> tuple[Sequence[str], np.ndarray, np.ndarray | None]:
        """Names, values and derivatives about log theta of all channels of one simulation."""
        if self._predictor is None:
            return self._inflated(physics, theta)
        runner = self._runner(physics, self._predictor)
        result = runner.run(theta)
        if result.status != "converged":
            raise ArithmeticError(result.reason)
        assert result.observables is not None and result.sensitivity is not None
        return runner.channels.names, result.observables, result.sensitivity * theta

    def _inflated(self, physics, theta):
        solver = Solver(make_simulator(self._mesh, physics), physics["solver"])
        simulator, effort = solver.simulator, Effort()
        values = np.empty(len(simulator.channels))
        for load in simulator.channels.load_fractions:
            state = solver.inflate(theta, load * simulator.full_pressure, effort)
            values[simulator.places_of(load)] = simulator.observables(state.w, None, load)[0]
        return simulator.channels.names, values, None

    def _runner(self, physics: Mapping, predictor: str | Path) -> Runner:
        if physics is not self._physics:
            return make_runner(self._mesh, physics, predictor)
        if self._base is None:
            self._base = make_runner(self._mesh, physics, predictor)
        return self._base


def unit_noise(effects: list[Effect], size: int, rng: np.random.Generator) -> np.ndarray:
    """Noise (size,) of unit scale, Gaussian unless an effect has another."""
    for effect in effects:
        noise = effect.hypothesis.noise(size, effect.value, rng)
        if noise is not None:
            return noise
    return rng.standard_normal(size)


# ---------------------------------------------------------------------------------- benchmark


KINDS = {"singles": 1, "pairs": 2, "triples": 3, "unlisted": 1, "nulls": 0}
"""Kind of benchmark subjects -> how many effects they have."""


def random_subjects(
    hearts: Mapping[str, int],
    seed: int,
    hypotheses: Mapping[str, Hypothesis],
    parameters: Parameterisation,
) -> list[dict]:
    """Entries as in `synthetic_subjects` (`theta`, `effects`, `seed`) with a name, `subject`, their
    `kind`, and `withheld`, the cause that their criticism may not know.

    hearts: how many of each of `KINDS`. Of subjects with one effect each hypothesis takes its turn
    after a shuffle, of the others all combinations are equally likely; what changes the noise
    stands alone. Values are uniform in the plausible range, on the scale of the hypothesis, but for
    what is close to the base (`LEAST_SHARE`). Theta is log-uniform in `PHYSIOLOGICAL`,
    as far as its bounds allow. Their order tells nothing. Raises InputError if there are fewer
    causes than a heart has effects.
    """
    rng = np.random.default_rng(derive(seed, "benchmark"))
    low = np.log(np.maximum(PHYSIOLOGICAL[0], parameters.lower))
    high = np.log(np.minimum(PHYSIOLOGICAL[1], parameters.upper))
    physical = [n for n, h in hypotheses.items() if not isinstance(h, NoiseHypothesis)]
    drawn = []
    for kind, count in hearts.items():
        size, among = KINDS[kind], list(hypotheses) if kind == "singles" else physical
        if count and len(among) < size:
            raise InputError(
                f"criticism.benchmark.hearts.{kind}: such a heart has {size} of the causes in "
                f"criticism.hypotheses that are not of the noise, which are {len(among)}; write 0, "
                "or add causes"
            )
        turns: list[str] = []
        for number in range(count):
            if size == 1:
                if number == len(turns):
                    turns += _shuffled(among, rng)
                names = [turns[number]]
            else:
                names = _shuffled(among, rng)[:size]
            effects: dict[str, float | dict] = {}
            for name in names:
                effects |= _random_effect(hypotheses[name], rng)
            drawn.append((kind, effects, names[0] if kind == "unlisted" else ""))
    entries = []
    for number, place in enumerate(rng.permutation(len(drawn))):
        theta = np.exp(rng.uniform(low, high))
        kind, effects, withheld = drawn[place]
        entries.append(
            {
                "subject": f"subject-{number:04d}",
                "kind": kind,
                "theta": dict(zip(parameters.names, theta.tolist(), strict=True)),
                "effects": effects,
                "withheld": withheld,
                "seed": derive(seed, "benchmark", number),
            }
        )
    return entries


def _shuffled(names, rng) -> list[str]:
    return [str(name) for name in rng.permutation(list(names))]


def _random_effect(hypothesis: Hypothesis, rng: np.random.Generator) -> dict:
    scale = hypothesis.scale
    base, low, high = (scale(v) for v in (hypothesis.base, hypothesis.low, hypothesis.high))
    below, above = base - low, high - base
    side = low if rng.uniform() < below / (below + above) else high
    value = float(scale.inverse(base + rng.uniform(LEAST_SHARE, 1.0) * (side - base)))
    component = ""
    if len(hypothesis.components) > 1:
        component = str(rng.choice(hypothesis.components))
    return {hypothesis.name: configured(value, component)}


def inject_batch(
    mesh: str | Path,
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

    mesh: finer than the study's, so that nothing rests on errors that both share. hypotheses:
    names, or `all`, as in the configuration; benchmark: its section
    `criticism.benchmark`; seed: the study's. Subjects (Parquet): `subject`, the D outputs with
    noise, their `sd_<output>`, and `withheld`, the cause that its criticism may not know. Truth,
    which no inference reads: `subject`, `kind`, theta, `effects` (JSON: name -> [value,
    component]), `shifts` (JSON, as of `shifts`), `status` and `reason`; a ventricle that cannot be
    inflated is in the truth alone.
    """
    catalogue = asked(hypotheses, physics)
    entries = random_subjects(benchmark["hearts"], seed, catalogue, parameters)
    first = int(batch) * batch_size
    ventricles = Ventricles(mesh, physics)
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
        truth = {"subject": entry["subject"], "kind": entry["kind"]} | entry["theta"]
        injected = {e.hypothesis.name: [e.value, e.component] for e in effects}
        truth |= {"effects": json.dumps(injected), "shifts": "{}"}
        truth |= {"status": "converged", "reason": ""}
        try:
            outputs = ventricles.outputs(theta, effects)
        except ArithmeticError as error:
            truth |= {"status": "failed", "reason": str(error)}
            log.warning("%s: %s failed: %s", name, entry["subject"], error)
        else:
            rng = np.random.default_rng(entry["seed"])
            unit = unit_noise(effects, len(channels), rng)
            table = synthetic_subject(outputs, channels, noise, unit).set_index("output")
            row = {"subject": entry["subject"], "withheld": entry["withheld"]}
            row |= table["value"].to_dict()
            subjects.append(row | table["sd"].add_prefix("sd_").to_dict())
            truth["shifts"] = json.dumps(shifts(ventricles, theta, effects, outputs))
        truths.append(truth)
        progress.step(failed=truth["status"] == "failed")
    return pd.DataFrame(subjects), pd.DataFrame(truths)


def shifts(
    ventricles: Ventricles, theta: np.ndarray, effects: list[Effect], outputs: np.ndarray
) -> dict[str, list[float] | None]:
    """What each effect does to the outputs (D,), without noise, of a ventricle that has the others
    too: by name; None if the ventricle without it cannot be inflated. Effects on the noise have
    none.

    outputs: (D,) with all effects.
    """
    found: dict[str, list[float] | None] = {}
    for effect in effects:
        if isinstance(effect.hypothesis, NoiseHypothesis):
            continue
        try:
            without = ventricles.outputs(theta, [e for e in effects if e is not effect])
        except ArithmeticError as error:
            log.warning("without %s: %s", effect.hypothesis.name, error)
            found[effect.hypothesis.name] = None
        else:
            found[effect.hypothesis.name] = (outputs - without).tolist()
    return found


# ------------------------------------------------------------------------------- confirmation


def simulate_design(
    design: pd.DataFrame, ventricles: Ventricles, physics: Mapping, parameters: Sequence[str]
) -> pd.DataFrame:
    """The `design` (rows as of `designs.design_rows`) with the outputs, by name, and their
    derivatives about log theta (`designs.slope_of`, P numbers each); without them, and with
    the `reason`, where the simulator failed.

    A set whose first simulations all fail (`HOPELESS`) is not simulated any further: what cannot be
    inflated takes twenty times as long as what can.
    """
    names, rows = ventricles.channels.names, []
    progress = Progress("confirmation", len(design))
    converged, failed = Counter[str](), Counter[str]()
    for _, row in design.iterrows():
        effects = [
            Effect(REGISTRY[name].for_study(physics), value, component)
            for name, (value, component) in json.loads(row["effects"]).items()
        ]
        theta, reason = row[list(parameters)].to_numpy(float), ""
        made = dict.fromkeys(names, np.nan) | dict.fromkeys(map(slope_of, names))
        own = f"{row['subject']}: {row['set']}"
        if failed[own] >= HOPELESS and not converged[own]:
            reason = f"not simulated: the first {HOPELESS} of this set failed"
        else:
            try:
                outputs, slopes = ventricles.linearised(theta, effects)
            except ArithmeticError as error:
                reason = str(error)
            else:
                assert slopes is not None  # a predictor is at hand
                made = dict(zip(names, outputs, strict=True))
                made |= {slope_of(n): s.tolist() for n, s in zip(names, slopes, strict=True)}
        (failed if reason else converged)[own] += 1
        rows.append(made | {"reason": reason})
        progress.step(failed=bool(reason))
    columns = [*names, *map(slope_of, names), "reason"]
    return pd.concat([design, pd.DataFrame(rows, columns=columns, index=design.index)], axis=1)


def simulate_sets(
    mesh: str | Path,
    predictor: str | Path,
    design: str | Path,
    physics: Mapping,
    parameters,
    part: str,
    parts: int,
    simulations: str | Path,
) -> None:
    """Simulate the `part` (from 0) of equal `parts` of a confirmation's design (Parquet); write it
    with the outputs.

    mesh, predictor, physics, parameters: the study's. A simulation that fails is a row with its
    reason.
    """
    ventricles = Ventricles(mesh, physics, predictor)
    table = pd.read_parquet(design)
    # Rows of one set follow one another, and a set has a simulator of its own.
    table = table.iloc[np.array_split(np.arange(len(table)), parts)[int(part)]]
    simulate_design(table, ventricles, physics, parameters.names).to_parquet(
        simulations, index=False
    )
