"""The configuration of a study: all its sections, and what spans them."""

import contextlib
import statistics
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated

from pydantic import AfterValidator, Field

from regional_lv.channels import Channels
from regional_lv.config.section import (
    ONCE,
    FilePath,
    Name,
    Natural,
    Note,
    Section,
    complaints,
    key_path,
)
from regional_lv.config.sections import heart, inference, simulation
from regional_lv.config.sections.criticism import Criticism
from regional_lv.config.sections.emulators import Emulators
from regional_lv.config.sections.subjects import (
    DEFAULT_SYNTHETIC,
    AnySubject,
    Cohort,
    Scenarios,
    Synthetic,
    default_subjects,
)
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.mechanics.materials import material_from_config
from regional_lv.mechanics.observables.layer import check_layer
from regional_lv.mechanics.supports import supports_from_config
from regional_lv.registry import load_plugins


def _loaded(paths: list[str]) -> list[str]:
    """Load plugins as soon as they are read: what they add is known to the sections that follow."""
    load_plugins(paths)
    return paths


class Resources(Section, reruns="the volunteer appears or disappears"):
    """Where the paper's published files come from; only `published_volunteer` needs one."""

    published_mirror: str | None = None
    """Folder with the published files; the environment variable `REGIONAL_LV_PUBLISHED` takes
    precedence."""
    download: bool = True
    """Fetch from the paper's public repository what the mirror does not have. With false, a study
    leaves the volunteer out that no mirror has."""


class Configuration(Section):
    """A study. Keys whose default follows from others stand after them."""

    study: Annotated[Name, Field(max_length=100), Note(reruns="everything, into another folder")]
    """Name of the study; everything it makes goes to `results/<study>/`."""
    seed: Annotated[Natural, Note(reruns="design and everything after it")] = 2026
    """Master seed; every random step derives its own from it and from its name."""
    evaluation: Annotated[bool, Note(reruns="nothing; it decides what is made")] = True
    """Whether the study also evaluates its emulators and posteriors: emulators compared, posteriors
    of the test set and of the scenarios, checks of the inference, the paper's numbers beside its
    own. With false it makes what concerns its subjects, and `emulators.final` has to be a name."""
    plugins: Annotated[
        list[FilePath],
        ONCE,
        AfterValidator(_loaded),
        Note(reruns="everything that depends on the library; so does an edit of such a file"),
    ] = []
    """Python files that register a quantity, a material law, a support, a load, an emulator or an
    input of yours."""
    parameters: heart.Parameters = heart.Parameters()
    geometry: heart.AnyGeometry = heart.OfSegments(source="segments")
    mesh: heart.Mesh = heart.Mesh()
    fibres: heart.Fibres = heart.Fibres()
    material: heart.Material = heart.Material()
    loading: heart.Loading = heart.Loading()
    supports: heart.Supports = heart.Supports()
    observables: heart.Observables = heart.Observables()
    solver: heart.Solver = heart.Solver()
    design: simulation.Design = simulation.Design()
    simulations: simulation.AnySimulations = simulation.Simulated(source="dolfinx")
    inputs: Annotated[
        dict[Name, simulation.InputRole],
        Note(
            reruns="the simulations over all inputs, and their emulator",
            remedy="write `inferred`, `measured`, `suspected` or `fixed`, or a section with `role` "
            "and, if it is measured, `sd_<unit>`",
        ),
    ] = Field(default_factory=simulation.default_roles, validate_default=True)
    """What the study does with each input of the simulator: its role by name, or by a word for
    several, such as `{septal_load: suspected, segment_thickness: {role: measured, sd_mm: 1.0}}`.
    The narrower name counts, and `causes` stands for all that a criticism doubts. What is not named
    is inferred if it is a stiffness, measured if the segment table has its sd, and fixed otherwise.
    Without this section it is `{causes: suspected}`; where simulations come from tables
    (`simulations.source`) it is empty, and nothing else is possible."""
    all_inputs: simulation.AllInputs = simulation.AllInputs()
    reduction: simulation.Reduction = simulation.Reduction()
    emulators: Emulators = Emulators()
    map: inference.Map = inference.Map()
    estimates: inference.Estimates = inference.Estimates()
    efficiency: inference.Efficiency = inference.Efficiency()
    nuts: inference.Nuts = inference.Nuts()
    clinical: inference.Clinical = inference.Clinical()
    trust: inference.Trust = inference.Trust()
    test_posteriors: inference.TestPosteriors = inference.TestPosteriors()
    scenarios: Scenarios = Scenarios()
    synthetic_subjects: Annotated[
        dict[Name, Synthetic],
        Note(reruns="that subject's measured file, posterior and figures"),
    ] = DEFAULT_SYNTHETIC
    """Ventricles with a known truth, by name. Their measured files come out of the simulator with
    noise added. Of several configurations, those that `subjects` does not name count in the last
    one only."""
    subjects: Annotated[
        dict[Name, AnySubject], Note(reruns="that subject's posterior and figures")
    ] = Field(default_factory=default_subjects, validate_default=True)
    """Measurements whose stiffness is inferred, by name (letters, digits, underscore). All share
    the study's geometry and pressure: another heart is another study, or one of a `cohort`. Without
    this section they are those of `synthetic_subjects` and, in studies with `evaluation`, the
    volunteer."""
    cohort: Cohort = Cohort()
    criticism: Criticism = Criticism()
    resources: Resources = Resources()

    @property
    def meshes_anew(self) -> bool:
        """Whether the study makes its meshes itself, so that it can make finer ones."""
        return meshes_anew(self.model_dump())

    @cached_property
    def theta(self) -> StiffnessInputs:
        """What is inferred. Raises InputError."""
        return StiffnessInputs.from_config(self.model_dump())

    @cached_property
    def channels(self) -> Channels:
        """What is observed. Raises InputError."""
        return Channels.from_config(self.model_dump())

    @cached_property
    def has_heart(self) -> bool:
        """Whether `geometry` is without mistakes, so that its files can be read."""
        parts = sections_of(self.geometry, "geometry")
        return not any(mistake for path, part in parts for mistake in part.check(path, self))

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Simulations of the training and of the test set. Raises InputError for tables that
        cannot be used."""
        return self.simulations.sizes(self)

    @property
    def least_simulations(self) -> int:
        """How many every emulator needs."""
        return len(self.theta) + 2

    def finish(self) -> list[str]:
        """Fill in what follows from several sections; lines about what does not fit."""
        if isinstance(self.simulations, simulation.Tabulated) and self.simulations.holdout is None:
            own = "test" in self.simulations.tables
            self.simulations.holdout = 0 if own else self.design.test
        self._fit_defaults()
        mistakes = []
        for path, section in sections_of(self):
            with contextlib.suppress(InputError):
                for mistake in section.check(path, self):
                    mistakes.append(mistake)
        mistakes += self._not_made(looks_sound=not mistakes)
        if isinstance(self.simulations, simulation.Tabulated) and not mistakes:
            # The one place that says how many test cases there are.
            self.design.test = self.sizes["test"]
        return mistakes

    def _not_made(self, looks_sound: bool) -> list[str]:
        """What makers of objects have against their sections; of several, if these look sound."""
        config = self.model_dump()
        found = [
            *complaints(supports_from_config, config["supports"]),
            *complaints(material_from_config, config["material"]),
            *complaints(check_layer, *config["observables"]["layer"]),
            *complaints(lambda: self.channels),
            *(complaints(lambda: self.theta) if self.design.lower < self.design.upper else ()),
        ]
        if found or not looks_sound:
            return found
        if not self.inputs:
            return complaints(lambda: self.sizes)
        # The catalogue reads segment tables: pandas, for every process that reads a configuration.
        from regional_lv.inputs.space import Inputs

        return complaints(Inputs.from_config, config)

    def check(self, key, study) -> Iterator[str]:
        if self.simulations.source == "table" and self.inputs:
            yield (
                "inputs: roles ask for simulations of their own, and `simulations.source: table` "
                "runs none; remove one of them"
            )
        if self.sizes["train"] < self.least_simulations:
            where = "simulations.tables.train" if self.simulations.source == "table" else "design"
            yield (
                f"{where}: {self.sizes['train']} training simulations are too few for any "
                f"emulator; give {self.least_simulations} or more"
            )

    def _fit_defaults(self) -> None:
        """Leave out default scenarios and synthetic subjects that the study does not ask for, or
        cannot have: outside its bounds, or with effects that are part of its model."""

        def fits(section: Section) -> bool:
            try:
                return not any(section.check("", self))
            except InputError:
                return True  # of a mistake that is reported with everything else

        if "sets" not in self.scenarios.model_fields_set:
            sets = self.scenarios.sets.items()
            self.scenarios.sets = {name: each for name, each in sets if fits(each)}
        if "synthetic_subjects" in self.model_fields_set:
            return
        self._carry_over()
        asked_for = "subjects" in self.model_fields_set
        for name, subject in list(self.synthetic_subjects.items()):
            if name not in self.subjects if asked_for else not fits(subject):
                del self.synthetic_subjects[name]
                self.subjects.pop(name, None)

    def _carry_over(self) -> None:
        """Give the default subjects, whose theta is in the paper's zones, the zones of the study.

        A zone has the mean of its segments; a factor that the paper's law does not have is 1, but
        for the one that scales all stresses.
        """
        paper = StiffnessInputs()
        try:
            own = self.theta
        except InputError:
            return  # reported with everything else
        if own.names == paper.names:
            return
        stress = next(p.factor for p in paper if p.stress_power)
        for subject in self.synthetic_subjects.values():
            given = subject.theta
            subject.theta = {
                p.name: statistics.mean(
                    given.get(f"{stress if p.stress_power else p.factor}_{paper.zone_of(s)}", 1.0)
                    for s in own.zones[p.zone]
                )
                for p in own
            }


def sections_of(section: Section, path: str = "") -> Iterator[tuple[str, Section]]:
    """A section and all that it holds, with their paths."""
    yield path, section
    for name, value in section:
        for key, item in value.items() if isinstance(value, dict) else [("", value)]:
            if isinstance(item, Section):
                yield from sections_of(item, key_path(path, name, key))


def meshes_anew(config) -> bool:
    """Whether a study makes its meshes itself, so that it can make finer ones."""
    geometry = config["geometry"]
    return geometry["source"] != "mesh" or geometry["imported"]["remesh"]
