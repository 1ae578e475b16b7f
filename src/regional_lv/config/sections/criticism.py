"""What the model could have wrong."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from regional_lv.config.section import (
    ONCE,
    Count,
    FilePath,
    Fraction,
    Name,
    Natural,
    Note,
    Positive,
    Section,
    Whole,
)
from regional_lv.config.sections.heart import missing_file
from regional_lv.config.sections.subjects import Noise
from regional_lv.data.published import PUBLISHED
from regional_lv.errors import closest
from regional_lv.inputs.stiffness import StiffnessInputs

Replicates = Annotated[Whole, Field(ge=49)]


class Confirmation(Section):
    """Simulations of the leading models at draws of their posterior. They join what the emulator
    learns from; where it differs from them by more than it stated, the posterior is made and
    simulated again."""

    sets: Count = 3
    """Models that are simulated, at most, in each round."""
    simulations: Annotated[Whole, Field(ge=2)] = 8
    """Of a round, shared out by the models' probabilities."""
    rounds: Count = 3
    """At most; a model whose errors are still larger then is not confirmed."""


class Joint(Section):
    """Subjects that are criticised together."""

    subjects: Annotated[list[str], Field(min_length=1), ONCE]
    """Names of `subjects`; one value of every cause holds for all of them."""
    theta: FilePath | None = None
    """Table (CSV: `subject` and the parameters) of thetas that are known up to one number per
    factor of the law, the same in all zones, which the subjects share; `published` for subjects
    that are published simulations; null: unknown."""

    def check(self, key, study) -> Iterator[str]:
        if key.rpartition(".")[2] in study.subjects:
            yield f"{key}: a subject has this name, too, and both write there; choose another"
        for subject in self.subjects:
            if subject not in study.subjects:
                close = closest(subject, study.subjects)
                hint = f"did you mean {close}?" if close else "add it to `subjects`"
                yield f"{key}.subjects: there is no subject {subject}; {hint}"
        if self.theta != PUBLISHED:
            yield from missing_file(f"{key}.theta", self.theta)
        elif study.theta.names != StiffnessInputs().names:
            yield (
                f"{key}.theta: the published thetas are of the paper's zones and factors; set "
                "`parameters` to them, or give a table of all thetas"
            )
        else:
            for subject in self.subjects:
                if getattr(study.subjects.get(subject), "source", "") != "published_simulation":
                    yield (
                        f"{key}.theta: the theta of {subject} is not published; give a table of "
                        "all thetas, or leave the subject out"
                    )


class Hearts(Section):
    """How many ventricles of each kind."""

    singles: Natural = 60
    """With one effect."""
    pairs: Natural = 60
    """With two effects."""
    triples: Natural = 20
    """With three effects."""
    unlisted: Natural = 30
    """That differ in ways which no catalogue lists, or by a cause that their criticism does not
    search."""
    nulls: Natural = 200
    """Without any."""
    misread: Natural = 60
    """Without any, and with a segment table whose thicknesses are wrong by 10 % and radii by 3 %
    (sd)."""


class BenchmarkNoise(Noise):
    """Standard deviations of the noise; a plugin's quantity without one is not measured."""

    strain: Positive = 0.01
    volume: Annotated[Positive, Note(unit="mL")] = 1.0
    torsion: Annotated[Positive, Note(unit="deg/mm")] = 0.01
    shortening: Positive = 0.005


class Benchmark(Section, reruns="the benchmark of hidden effects"):
    """Ventricles with effects drawn from the catalogue, and without any."""

    bootstrap: Replicates = 299
    """As `criticism.bootstrap`, for each of them."""
    subjects_per_batch: Count = 10
    """Subjects per job."""
    hearts: Hearts = Hearts()
    noise: BenchmarkNoise = BenchmarkNoise()


class Criticism(Section, reruns="the criticism of all subjects"):
    """What the model could have wrong: tests of every subject's model, the search over sets of
    suspected inputs and, but in studies of tables, simulations that confirm the leading ones."""

    bootstrap: Replicates = 999
    """Data sets drawn from the fitted model and fitted again; the smallest p-value is one over one
    more than this."""
    level: Fraction = 0.05
    """Level of the tests, over the whole catalogue."""
    largest_set: Count = 4
    """Largest number of causes in a set. Every set of up to three is evaluated; larger ones are
    built from the best."""
    confirmation: Confirmation = Confirmation()
    load_fractions: list[Fraction] = [0.75, 0.5]
    """Shares of the end-diastolic pressure at which the ventricle could be imaged, too: where
    causes have similar effects at end diastole, the channel and load that would separate them are
    named."""
    joint: Annotated[dict[Name, Joint], Note(reruns="that joint criticism")] = {}
    """Subjects that are criticised together, by a name of their own."""
    benchmark: Benchmark = Benchmark()

    def check(self, key, study) -> Iterator[str]:
        for path, replicates in (
            (key, self.bootstrap),
            (f"{key}.benchmark", self.benchmark.bootstrap),
        ):
            if self.level * (1 + replicates) < 1:
                yield (
                    f"{key}.level: {self.level} is never reached with {replicates} replicates; "
                    f"raise it, or {path}.bootstrap"
                )
        if self.joint and not study.inputs:
            yield (
                f"{key}.joint: nothing is suspected; make inputs suspected, such as `inputs: "
                "{causes: suspected}`, or remove it"
            )
