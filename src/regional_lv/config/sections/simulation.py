"""Where is simulated and how, over which inputs, and how the outputs are reduced."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_serializer

from regional_lv.config.section import (
    OTHER,
    TEXT_OR_ELSE,
    WORD,
    Count,
    FilePath,
    Kind,
    Name,
    Natural,
    NonNegative,
    Note,
    Positive,
    Section,
    Share,
    Whole,
    by_default,
    complaints,
)
from regional_lv.data.published import PUBLISHED, PUBLISHED_ROWS, PUBLISHED_TABLES
from regional_lv.emulators import least_simulations
from regional_lv.errors import InputError
from regional_lv.inputs.base import RoleName

KEPT = "an imported mesh that is kept cannot be made finer (geometry.imported.remesh)"
"""Of what needs a finer mesh."""

Bound = Annotated[Positive, Note(reruns="mechanics and everything after it")]


class Design(Section, reruns="design and everything after it"):
    """Where to simulate: Sobol points in the box of the parameters, [lower, upper] unless
    `parameters.bounds` says otherwise, which is also the prior's support."""

    lower: Bound = 0.1
    """Lower bound."""
    upper: Bound = 5.0
    """Upper bound."""
    natural: Count = 4196
    """Training simulations spread evenly on the natural scale."""
    log: Natural = 1465
    """Training simulations spread evenly on the log scale."""
    test: Count = 120
    """Simulations of the independent test set."""

    def check(self, key, study) -> Iterator[str]:
        if self.lower >= self.upper:
            yield (
                f"{key}.lower: {self.lower} is not below design.upper ({self.upper}); exchange them"
            )


class Simulations(Kind, tag="source", reruns="simulations and everything after them"):
    """How the design is run, or where finished simulations are."""

    source: str = "dolfinx"
    """`dolfinx`: run them; `table`: take finished ones (`tables`), and run no mechanics at all."""
    batch_size: Count = 50
    """Simulations per job."""
    anchors: Annotated[Whole, Field(ge=2)] = 120
    """Simulations of the training design that are solved first; their displacement fields predict
    those of all others."""

    def sizes(self, study) -> dict[str, int]:
        """Rows of the sets, `train` and `test` after the split (without what is held out beside a
        test table). Raises InputError for tables that cannot be used."""
        design = study.design
        return {"train": design.natural + design.log, "test": design.test}


class Simulated(Simulations):
    """By the study itself."""

    source: Literal["dolfinx"]


class Table(Section):
    """Finished simulations of one set."""

    inputs: FilePath
    """Parameters: Parquet or CSV with named columns (C_a_anterior, ...), or, of the paper's
    parameters, CSV without a header in the published order; `published` is the paper's table: of
    `train` its 5,661 training simulations, of `test` the first 128 of its test simulations. Of a
    scenario, named columns with one more, `zone`: the stiff zone of each row, or `all` with `kind:
    global`."""
    outputs: FilePath
    """Outputs, row by row those of the inputs: named columns (volume_ml, circumferential_01,
    circumferential_01@0.5, ...), or the published order; `published` as for the inputs."""

    @property
    def published(self) -> bool:
        return PUBLISHED in (self.inputs, self.outputs)

    def read(self, study, stiff=()):
        """The table, for the parameters and channels of the study; stiff: as in `read_tables`.
        Raises InputError."""
        # Imported here because pandas takes longer to load than the rest of this module.
        from regional_lv.simulation.tables import read_tables

        files = self.model_dump()
        return read_tables(**files, parameters=study.theta, channels=study.channels, stiff=stiff)

    def check(self, key, study) -> Iterator[str]:
        from regional_lv.simulation.scenarios import scenario_size, stiff_zones
        from regional_lv.simulation.tables import SENSITIVITY, published_order

        parameters, channels, columns = study.theta, study.channels, ()
        name = key.rpartition(".")[2]
        if self.published:
            if name not in PUBLISHED_TABLES or {self.inputs, self.outputs} != {PUBLISHED}:
                yield (
                    f"{key}: `{PUBLISHED}` is the paper's training or test table, inputs and "
                    "outputs together; name it for both of `train` or of `test`, or give paths"
                )
            elif not published_order(parameters, channels):
                yield (
                    f"{key}: `{PUBLISHED}` holds the paper's parameters and channels; leave "
                    "`parameters`, `observables` and `loading.frames` at their defaults, or give "
                    "paths"
                )
        else:
            scenario = study.scenarios.sets.get(name)
            stiff: tuple[str, ...] = ()
            if scenario is not None:
                stiff = stiff_zones(scenario.model_dump(), parameters)
            mistakes = complaints(self.read, study, stiff)
            yield from (f"{key}: {mistake}" for mistake in mistakes)
            if mistakes:
                return
            table = self.read(study)
            columns = table.columns
            if scenario is not None:
                size = scenario_size(scenario.model_dump(), parameters)
                if len(table) > size:
                    yield (
                        f"{key}: {len(table)} rows for the {size} ventricles of "
                        f"scenarios.sets.{name}; raise its number of samples, or remove rows"
                    )
        learner = "gradient_gp"
        if name == "train" and learner in study.emulators.names and SENSITIVITY not in columns:
            yield (
                f"{key}: has no column {SENSITIVITY}, and {learner} learns from sensitivities; add "
                f"it (Parquet, {len(channels) * len(parameters)} numbers per row), or leave "
                f"{learner} out of emulators.names"
            )


class Tabulated(Simulations):
    """By others, or before."""

    source: Literal["table"]
    tables: dict[Name, Table] = {}
    """Finished simulations by set: `train`, `test` (or rows held out of `train`), and any
    scenario, with no more rows than it has ventricles."""
    holdout: Natural | None = None
    """Training simulations that are held out (seeded). Without a table `test` they are the test
    set. Beside one they are a second test set, `holdout`, on which the emulators' point estimates
    and predictions are scored, too; nothing else uses it. null: `design.test` of them without a
    table `test`, none beside one."""
    rows: Annotated[Whole, Field(ge=3)] | None = None
    """Training simulations that are used, at most (a seeded choice, after the holdout); null:
    all."""

    def check(self, key, study) -> Iterator[str]:
        if "test" not in self.tables and self.holdout == 0:
            yield (
                f"{key}.holdout: 0 leaves no test set; hold out one row or more, or give a test "
                "table (simulations.tables.test)"
            )
        known = ("train", "test", *study.scenarios.sets)
        for table in sorted(set(self.tables) - set(known)):
            yield (
                f"{key}.tables.{table}: the study has no set of this name; use one of "
                f"{', '.join(known)} (rows held out of `train` need no table: simulations.holdout)"
            )

    def sizes(self, study) -> dict[str, int]:
        from regional_lv.simulation.tables import split

        if "train" not in self.tables:
            raise InputError(
                "simulations.tables.train: missing; give the inputs and outputs to learn from"
            )
        sizes = {
            name: PUBLISHED_ROWS.get(name, 0) if table.published else len(table.read(study))
            for name, table in self.tables.items()
        }
        holdout = self.holdout or 0
        parts = split(sizes["train"], holdout, self.rows, study.seed)
        return {"test": holdout} | sizes | {"train": len(parts["train"])}


AnySimulations = Annotated[
    Simulated | Tabulated, Field(discriminator="source"), by_default(source="dolfinx")
]


class AllInputs(Section, reruns="these simulations, and the emulator of all inputs"):
    """Simulations over all inputs that are not fixed, made in every study but one of tables."""

    emulator: Literal["own", "shipped"] = "own"
    """`own`: one is trained on these simulations alone; `shipped`: they join the emulator of any
    heart that comes with the package, so that 20 to 40 are enough. The heart has to be within what
    that knows (`regional-lv run` sees to it), and `mesh` that of config/heart_emulator.yaml."""
    shapes: Literal["study", "population"] = "study"
    """Whose shape is simulated: `study`, the study's heart, within the ranges of its shape inputs;
    `population`, plausible ventricles of all kinds with its table's angles and levels
    (`hearts.population`), for an emulator of any heart. All their shape inputs then have to be
    inferred."""
    simulations: Annotated[Whole, Field(ge=4)] = 400
    """For training, each with derivatives with respect to all inputs. More of them leave those that
    there are as they are."""
    test: Count = 50
    """For the emulator's errors."""
    anchors: Annotated[Whole, Field(ge=2)] = 48
    """Of these solved first, from which the fields of the others are predicted."""
    finer: Natural = 0
    """Anchors that are simulated again on a finer mesh, by whose differences the emulator is
    corrected. 0: nothing of this. Worth it where `mesh` is coarse; not possible for an imported
    mesh that is kept."""
    steepest: Annotated[float, Field(gt=1)] = 5.0
    """Simulations whose derivatives are more than as many times the median's are left out: the wall
    is about to lose its stability."""

    def check(self, key, study) -> Iterator[str]:
        if self.finer and not study.meshes_anew:
            yield f"{key}.finer: {KEPT}; write 0"
        if not self.finer and self.shapes == "study":
            return
        from regional_lv.inputs.space import Inputs

        inputs = Inputs.from_config(study.model_dump())
        on_both = min(self.finer, self.anchors, self.simulations)
        least = least_simulations(len(inputs.simulated), with_sensitivities=True)
        if self.finer and on_both < least:
            yield (
                f"{key}.finer: {on_both} simulations on both meshes are too few to learn what the "
                f"finer one changes; give {least} or more, and as many `anchors`, or write 0"
            )
        if self.shapes == "study":
            return
        from regional_lv.hearts.population import COLUMNS

        roles = dict(zip(inputs.names, (role.kind for role in inputs.roles), strict=True))
        if any(roles.get(column) != "inferred" for column in COLUMNS):
            yield (
                f"{key}.shapes: a population has shapes of all kinds, and not all shape inputs are "
                "inferred; write `inputs: {segment_thickness: inferred, endo_radius: inferred, "
                "apex: inferred, level_end: inferred}` for a heart from a segment table, or "
                "`shapes: study`"
            )


class Role(Section, extra="allow"):
    """The role of one input, or of those of a word. Which unit its sd has says the input."""

    __pydantic_extra__: dict[Annotated[str, Field(pattern="^sd(_[a-z_]+)?$")], NonNegative]

    role: RoleName
    """What the study does with it."""
    value: float | None = None
    """Its value in place of the nominal one."""
    range: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    """Its range in its unit, in place of the plausible one, such as `[0, 30]`."""

    @model_serializer(mode="wrap")
    def _as_given(self, own):
        return {key: value for key, value in own(self).items() if value is not None}


InputRole = Annotated[
    Annotated[RoleName, WORD] | Annotated[Role, OTHER],
    TEXT_OR_ELSE,
    Field(
        description="`inferred`, `measured`, `suspected` or `fixed`, or a section with the `role`, "
        "the `value` and the `range` in place of its own, and of what is measured the standard "
        "deviation in its unit (`sd_mm`, `sd_deg`, `sd_mmhg`, `sd` of what has none)."
    ),
]


def default_roles(given: dict[str, Any]) -> dict:
    """The roles of a study that names none."""
    return {} if given["simulations"].source == "table" else {"causes": "suspected"}


class Reduction(Section, reruns="reduction and everything after it"):
    """Principal components of the standardised strains; other quantities are kept apart."""

    explained_variance: Share = 0.999
    """Share of the strain variance that the kept components explain."""
