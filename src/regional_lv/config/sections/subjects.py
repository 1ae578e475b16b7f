"""Whose stiffness is inferred: measured and synthetic ventricles, scenarios and cohorts."""

import warnings
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from regional_lv.config.section import (
    OTHER,
    TEXT_OR_ELSE,
    WORD,
    Count,
    FilePath,
    FilePattern,
    Kind,
    Name,
    Natural,
    Note,
    Positive,
    Section,
    Whole,
    complaints,
    not_offered,
)
from regional_lv.config.sections.simulation import KEPT
from regional_lv.data.published import SLICES_OF_LEVEL
from regional_lv.errors import InputError, closest
from regional_lv.inputs.stiffness import PAPER_ZONES
from regional_lv.quantities import QUANTITIES

RESERVED = {"train", "test", "holdout", "resimulated", "subjects"}
"""Names that no scenario may have."""

Noiseless = Positive | None
OF_PLUGIN = Field(description="Noise of a quantity that a plugin adds.")


def _noises() -> set[str]:
    return {kind.noise for kind in QUANTITIES.values()}


class Noise(Section, added=_noises, extra="allow"):
    """Standard deviations of the Gaussian noise that is added; a plugin's quantity without one is
    not measured."""

    __pydantic_extra__: dict[str, Annotated[Positive, OF_PLUGIN]]

    strain: Positive = 0.02
    """Noise of every strain."""
    volume: Annotated[Positive, Note(unit="mL")] = 2.0
    """Noise of the volume."""
    torsion: Annotated[Positive, Note(unit="deg/mm")] = 0.02
    """Noise of the torsion."""
    shortening: Positive = 0.01
    """Noise of the shortening."""

    def check(self, key, study) -> Iterator[str]:
        scales = {QUANTITIES[quantity].noise for quantity in study.channels.quantities}
        if not scales & set(self.model_dump()):
            yield (
                f"{key}: nothing that the study observes is measured; name the noise of a quantity"
            )


class ScenarioNoise(
    Section,
    reruns="the noisy scenarios' posteriors and figures",
    added=QUANTITIES.keys,
    extra="allow",
):
    """Standard deviations of the measurement noise of the sets `<scenario>-noisy`, Gaussian and
    known to the likelihood, by quantity; what is null, or a plugin's and not named, is not
    measured."""

    __pydantic_extra__: dict[str, Annotated[Noiseless, OF_PLUGIN]]

    volume: Annotated[Noiseless, Note(unit="mL")] = 2.0
    """Noise of the volume."""
    circumferential: Noiseless = 0.02
    """Noise of every circumferential strain."""
    radial: Noiseless = 0.05
    """Noise of every radial strain."""
    longitudinal: Noiseless = 0.02
    """Noise of every longitudinal strain."""
    torsion: Annotated[Noiseless, Note(unit="deg/mm")] = 0.02
    """Noise of the torsion."""
    shortening: Noiseless = 0.01
    """Noise of the shortening: about a millimetre of the long axis."""

    def check(self, key, study) -> Iterator[str]:
        noise = self.model_dump()
        if all(noise.get(quantity) is None for quantity in study.channels.quantities):
            yield f"{key}: no quantity that the study observes is measured; name a noise"


class Scenario(Kind, tag="kind"):
    """Ventricles with stiff zones."""

    kind: str
    """`local`: one zone is stiff; `global`: all are."""
    mu: Positive
    """Mean of all factors of stiff zones, within their bounds."""
    sd: Positive = 0.5
    """Their standard deviation; normal, truncated to the bounds. The paper writes N(mu, 0.5); its
    published scenario inputs scatter by 0.44 to 0.51 in the local scenarios, so the second number
    is no variance (in the global one they scatter by 0.20 only)."""

    def check(self, key, study) -> Iterator[str]:
        if study.evaluation:
            yield from outside(f"{key}.mu", self.mu, study)
        if key.rpartition(".")[2] in RESERVED:
            yield f"{key}: the name is taken by another set; choose another"


class LocalScenario(Scenario):
    """One zone after the other is stiff."""

    kind: Literal["local"]
    samples_per_zone: Count = 20
    """Ventricles for each stiff zone in turn."""


class GlobalScenario(Scenario):
    """All zones are stiff."""

    kind: Literal["global"]
    samples: Count = 100
    """Ventricles."""


class Scenarios(Section, reruns="the scenarios' simulations, posteriors and figures"):
    """Simulated disease with known truth: zones stiffened one at a time, or all together."""

    sets: Annotated[
        dict[Name, Annotated[LocalScenario | GlobalScenario, Field(discriminator="kind")]],
        Note(reruns="that scenario's simulations, posteriors and figures"),
    ] = {
        "local_1_5": LocalScenario(kind="local", mu=1.5),
        "local_2_0": LocalScenario(kind="local", mu=2.0),
        "local_3_0": LocalScenario(kind="local", mu=3.0),
        "global_1_7": GlobalScenario(kind="global", mu=1.7),
    }
    """Scenarios by name (letters, digits, underscore); default ones outside the bounds of the
    study's parameters are left out."""
    healthy_mean: Positive = 1.0
    """Mean of all factors of healthy zones. The paper's text has 1; its published inputs 1.2,
    spread evenly over 1.1 to 1.3."""
    healthy_sd: Positive = 0.05
    """Their standard deviation (the paper writes N(1, 0.05); as for `sd`)."""
    noise: ScenarioNoise = ScenarioNoise()

    def check(self, key, study) -> Iterator[str]:
        if study.evaluation:
            yield from outside(f"{key}.healthy_mean", self.healthy_mean, study)


def outside(key: str, mean: float, study) -> Iterator[str]:
    """The line about a mean at `key` that is outside the box of all parameters."""
    lower, upper = study.theta.lower.max(), study.theta.upper.min()
    if not lower <= mean <= upper:
        yield (
            f"{key}: {mean:g} lies outside [{lower:g}, {upper:g}] (design.lower, "
            "design.upper, parameters.bounds), where there are no training simulations; move it "
            "inside"
        )


class Synthetic(Section):
    """A ventricle with a known truth."""

    theta: dict[Name, float]
    """True parameters by name within their bounds, all of them."""
    effects: dict[Name, float] = {}
    """What the model has wrong about this ventricle: values of inputs, by the names that `inputs`
    knows (docs/inputs.md), such as `{septal_load: 4, focal_scar_8: 2.5}`."""
    mesh: Literal["study", "finer"] = "study"
    """What the ventricle is simulated on: the study's mesh, or one that is finer in every
    direction, so that nothing is found for sharing the study's errors of discretisation."""
    noise: Noise = Noise()
    seed: Natural | None = None
    """Seed of its noise; derived from the master seed if null."""

    def check(self, key, study) -> Iterator[str]:
        parameters = study.theta
        yield from not_offered(f"{key}.theta", self.theta, parameters.names)
        missing = [name for name in parameters.names if name not in self.theta]
        if missing:
            yield f"{key}.theta: missing {', '.join(missing)}; add what is missing"
        for p in parameters:
            if p.name in self.theta and not p.low <= self.theta[p.name] <= p.high:
                yield (
                    f"{key}.theta.{p.name}: {self.theta[p.name]} lies outside [{p.low}, "
                    f"{p.high}] (design.lower, design.upper, parameters.bounds), where nothing is "
                    "simulated; move it inside"
                )
        if self.mesh == "finer" and not study.meshes_anew:
            yield f"{key}.mesh: {KEPT}; write study"
        yield from self._check_effects(key, study)

    def _check_effects(self, key, study) -> Iterator[str]:
        if not self.effects or not study.has_heart:
            return
        # The catalogue reads segment tables: pandas, for every process that reads a configuration.
        from regional_lv.inputs.model import model_of
        from regional_lv.inputs.space import catalogue, why_unknown

        try:
            model = model_of(study.model_dump())
            every = catalogue(model)
        except InputError:
            return  # there is no such model, which is reported with everything else
        known = {each.name: each for each in every if each.nominal is not None}
        for name, value in self.effects.items():
            if name not in known:
                yield f"{key}.effects.{name}: {why_unknown(name, [*known.values()], model)}"
            elif not known[name].low <= value <= known[name].high:
                each = known[name]
                yield (
                    f"{key}.effects.{name}: {value} lies outside the plausible range, {each.low:g} "
                    f"to {each.high:g} {each.unit}; move it inside"
                )


def _theta(lateral: tuple[float, float]) -> dict[str, float]:
    """Of a ventricle in the paper's zones whose lateral wall is another one."""
    factors = [(1.0, 1.0), (1.1, 0.9), lateral, (0.9, 1.1), (1.0, 1.0)]
    return {
        f"{name}_{zone}": value
        for zone, pair in zip(PAPER_ZONES, factors, strict=True)
        for name, value in zip(("C_a", "C_b"), pair, strict=True)
    }


DEFAULT_SYNTHETIC = {
    # a stiffer lateral wall; in other zones, the mean of their segments
    "synthetic_lateral": Synthetic(theta=_theta((2.0, 1.5))),
    # two things that the model does not know, for the criticism to find
    "synthetic_hidden": Synthetic(
        theta=_theta((1.4, 1.2)),
        effects={"septal_load": 4.0, "basal_motion": 5.0},
        noise=Noise(strain=0.01, volume=1.0),
        mesh="finer",
    ),
}


class Subject(Kind, tag="source"):
    """Measurements of one ventricle."""

    source: str
    """`synthetic` (made from the entry of the same name in `synthetic_subjects`), `file` (your
    measured file), `curves` (strain curves over the frames of a cine), `published_volunteer` (the
    paper's healthy volunteer) or `published_simulation` (one of the paper's training simulations as
    if measured)."""


class SyntheticSubject(Subject):
    """Out of the simulator."""

    source: Literal["synthetic"]

    def check(self, key, study) -> Iterator[str]:
        name = key.rpartition(".")[2]
        if name not in study.synthetic_subjects:
            close = closest(name, study.synthetic_subjects)
            hint = f"did you mean the name {close}?" if close else "add it there"
            yield f"{key}: synthetic_subjects has no entry {name}; {hint}"
        if study.simulations.source == "table":
            yield (
                f"{key}: synthetic subjects come out of the simulator, which `simulations.source: "
                "table` does without; remove it"
            )


class Measured(Subject):
    """By segments."""

    segments: Literal[16, 17, 18] = 17
    """The model that the file counts its segments by: 17 (AHA), 16 (the same without the apex) or
    18 (six apical walls and no apex, as EchoPAC and others export). Of 18, the four apical segments
    of the AHA are means by angle."""


class FileSubject(Measured):
    """From a measured file."""

    source: Literal["file"]
    measured: FilePath
    """Path of a measured file, tidy CSV; the package's `data/measured_template.csv` shows the
    form."""

    def check(self, key, study) -> Iterator[str]:
        # Imported here because pandas takes longer to load than the rest of this module.
        from regional_lv.measured import read_measured

        exponent, pressure = study.observables.strain_exponent, study.loading.pressure_mmhg
        with warnings.catch_warnings():
            # The job that imports the file says them once, in its log.
            warnings.simplefilter("ignore")
            how = study.channels, pressure, exponent, self.segments
            for complaint in complaints(read_measured, self.measured, *how):
                yield f"{key}.measured: {complaint}"


class CurvesNoise(Section):
    """The noise, if it is known; without `strain` it is inferred."""

    strain: Annotated[float, Field(gt=0, le=0.5)] | None = None
    """Standard deviation of every strain, as a fraction."""
    volume: Annotated[Positive | None, Note(unit="mL")] = None
    """Standard deviation of the volume."""


class CurvesSubject(Measured):
    """From strain curves."""

    source: Literal["curves"]
    curves: FilePath
    """Strain curves, wide CSV: a column `frame` or `time`, and one per direction and AHA segment
    (circumferential_01, radial_01, longitudinal_01, ...)."""
    unit: Literal["percent", "fraction"]
    """The unit of the strains, `percent` or `fraction`."""
    measure: Literal["engineering", "green"] = "engineering"
    """The strain measure of the curves: `engineering`, the change of length over the length at the
    reference, or `green`, half the change of its square."""
    reference: Literal["end_diastole", "end_systole"]
    """Where they are zero: `end_diastole` or `end_systole`."""
    frame: Annotated[
        Annotated[Literal["earliest_diastole"], WORD] | Annotated[Natural, OTHER],
        TEXT_OR_ELSE,
        Note(remedy="give the number of a frame, or earliest_diastole"),
    ]
    """The number of the unloaded frame (in its column `frame`, otherwise counted from 1), or
    `earliest_diastole`: the first one after the greatest contraction in which a tenth of it is
    gone."""
    end_diastole_frame: Natural | None = None
    """The number of the frame of end diastole. Null: with the `reference` `end_diastole` the one in
    which all curves are zero, otherwise the first."""
    volume_ml: Annotated[float, Field(ge=20, le=600)] | None = None
    """The end-diastolic volume of the cavity."""
    sd: CurvesNoise = CurvesNoise()

    def check(self, key, study) -> Iterator[str]:
        from regional_lv.measured.curves import read_curve_subject

        exponent = study.observables.strain_exponent
        own = self.model_dump()
        for complaint in complaints(read_curve_subject, own, study.channels, exponent):
            yield f"{key}.curves: {complaint}"
        if exponent != 2 and study.observables.line_share != 1:
            yield (
                f"{key}.curves: are strains of material lines, which are those of the tensor for "
                "Green's strain only; set observables.line_share: 1, or "
                "observables.strain_exponent: 2"
            )


class Published(Subject):
    """Of the paper."""

    def check(self, key, study) -> Iterator[str]:
        channels = study.channels
        if not (channels.at(1.0) & channels.is_strain).any():
            yield (
                f"{key}: the study observes no strain that was measured there; add circumferential "
                "or radial to observables.quantities, or remove it from `subjects`"
            )


class Volunteer(Published):
    """The paper's healthy volunteer."""

    source: Literal["published_volunteer"]
    frame: Annotated[
        Annotated[Literal["extrema"], WORD]
        | Annotated[Annotated[Whole, Field(ge=1, le=15)] | None, OTHER],
        TEXT_OR_ELSE,
        Note(remedy="give the number of a frame, or extrema"),
    ] = None
    """The cine frame (1 to 15) whose strains are taken, or `extrema`, the largest ones of each
    segment; null for the vector that the paper used."""
    slices: list[Annotated[Whole, Field(ge=1, le=5)]] | None = None
    """With `frame` only: the short-axis slices that count, at least one of 1 and 2 (basal), one of
    3 and 4 (mid), and 5 (apical); null for the mean of all at their level, as the paper has it."""

    def check(self, key, study) -> Iterator[str]:
        yield from super().check(key, study)
        if self.slices is None:
            return
        if self.frame is None:
            yield f"{key}.slices: slices are of a frame; add `frame: extrema` or the number of one"
        if not all(set(level) & set(self.slices) for level in SLICES_OF_LEVEL):
            yield (
                f"{key}.slices: {self.slices} lacks a level; name one of 1 and 2, one of 3 and 4, "
                "and 5"
            )


class PublishedSimulation(Published):
    """One of the paper's training simulations."""

    source: Literal["published_simulation"]
    row: Count
    """The row (1, 2, ...) of the published training simulations."""


AnySubject = Annotated[
    SyntheticSubject | FileSubject | CurvesSubject | Volunteer | PublishedSimulation,
    Field(discriminator="source"),
]


def default_subjects(given: dict[str, Any]) -> dict:
    """Those of a study that names none."""
    own = {name: {"source": "synthetic"} for name in given["synthetic_subjects"]}
    volunteer = {"volunteer": {"source": "published_volunteer"}}
    return own | (volunteer if given["evaluation"] else {})


class Cohort(Section, reruns="the answers of all hearts"):
    """Many hearts in one study, each with its own geometry, pressure and measured file
    (`regional-lv cohort`); a text alone stands for `hearts`. What else the configuration says holds
    for all of them, unless a heart's own says something else."""

    hearts: Annotated[
        FilePattern | None, Note(reruns="the answers of hearts that are new, and the summary")
    ] = None
    """A pattern of folders as `regional-lv new` writes them, such as `hearts/*/`; or a CSV with the
    columns `heart` (its name), `segments` (its table), `endo_apex_z_mm`, `epi_apex_z_mm`,
    `pressure_mmhg` and `measured`, and, where known, `pressure_sd_mmhg`, `wall_thickness_sd_mm` and
    `endo_radius_sd_mm`, whose paths may count from its folder."""
    hearts_per_batch: Count = 5
    """Hearts that one job answers, on average at most. Which are together depends on their names,
    so that another heart changes one batch only."""
    prevalence_prior: Annotated[
        Annotated[list[Positive], Field(min_length=2, max_length=2)] | None,
        Note(reruns="the summary"),
    ] = None
    """Both parameters of the Beta prior of the share of hearts that have a cause, such as `[1, 1]`
    for a uniform one. Null: its mean is the cause's prior probability in a heart by itself, and it
    counts as much as two hearts."""

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, given):
        return {"hearts": given} if isinstance(given, str) else given
