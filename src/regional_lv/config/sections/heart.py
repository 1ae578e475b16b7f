"""The heart: shape, mesh and fibres, material, load, supports, what is observed and inferred."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo

from regional_lv.config.section import (
    ONCE,
    OTHER,
    TEXT_OR_ELSE,
    WORD,
    Angle,
    Count,
    FilePath,
    Fraction,
    Kind,
    Name,
    NonNegative,
    Note,
    Part,
    Positive,
    Reading,
    Section,
    Share,
    Whole,
    by_default,
    complaints,
)
from regional_lv.data import TABLES, VOLUNTEER
from regional_lv.data.published import PUBLISHED_HEART
from regional_lv.mechanics.loads import LOADS
from regional_lv.mechanics.supports import SUPPORTS

PATHS = "give its path from the folder of the configuration, or from the one in which you start"
"""Where a path may count from."""

GEOMETRY = "geometry and everything after it"

MECHANICS = "mechanics and everything after it"

NO_PRESSURE = (
    "fill in the end-diastolic pressure of this ventricle in mmHg, from a catheter or estimated: "
    "the paper assumes 8 for a healthy volunteer, and above 16 it counts as raised (Paulus et al. "
    "2007, doi 10.1093/eurheartj/ehm037). Stresses are in proportion to it, so that a pressure 10 "
    "% too high makes every C_a come out 10 % too high, while C_b stays"
)
"""What to do about a pressure that is not given."""

Unit = Literal["mm", "cm", "m"]
Direction = Annotated[list[float], Field(min_length=3, max_length=3)]
Point = Annotated[Direction | None, Note(unit="of the surfaces")]


def missing_file(key: str, path: str | None) -> Iterator[str]:
    """The line about a path at `key` that leads nowhere."""
    if path is not None and not Path(path).is_file():
        yield f"{key}: there is no file {path}; {PATHS}"


class Geometry(Kind, tag="source", reruns=GEOMETRY):
    """The shape of the left ventricle at zero pressure (base plane z = 0, of two surfaces a plane
    through the origin; apex below)."""

    source: str = "segments"
    """`segments`: smooth surfaces through the values of a segment table; `mesh`: a hexahedral mesh
    with tagged segments (`imported`); `surfaces`: endocardium and epicardium as triangles
    (`surfaces`)."""
    wall_thickness_scale: Annotated[Positive, Note(reruns="mechanics and everything after it")] = (
        1.0
    )
    """Factor on the wall's thickness in the simulator: the endocardium stays, the epicardium moves.
    mesh.vtu shows the wall before it."""


class OfSegments(Geometry):
    """A heart from a segment table."""

    source: Literal["segments"]
    segments: FilePath = VOLUNTEER
    """Segment table (CSV): wall thickness, endocardial radius, angular and axial extent of each AHA
    segment; `volunteer` is the one of the paper's volunteer that comes with the package."""
    endo_apex_z_mm: Annotated[float, Field(lt=0)] = -74.4
    """Height of the endocardial apex."""
    epi_apex_z_mm: Annotated[float, Field(lt=0)] = -81.2
    """Height of the epicardial apex; below the endocardial one."""

    def check(self, key, study) -> Iterator[str]:
        if self.epi_apex_z_mm >= self.endo_apex_z_mm:
            yield f"{key}.epi_apex_z_mm: must lie below geometry.endo_apex_z_mm; lower it"
        if self.segments in TABLES:
            return
        yield from (mistakes := list(missing_file(f"{key}.segments", self.segments)))
        if not mistakes:
            # Imported here because pandas takes longer to load than the rest of this module.
            from regional_lv.geometry.table import check_apices, read_segments

            mistakes = complaints(read_segments, self.segments) or complaints(
                check_apices,
                self.segments,
                read_segments(self.segments),
                self.endo_apex_z_mm,
                self.epi_apex_z_mm,
            )
            yield from (f"{key}.segments: {mistake}" for mistake in mistakes)


class Imported(Section):
    """The mesh of source `mesh`."""

    file: FilePath | None = None
    """Mesh of eight-node hexahedra in a format that meshio reads (Abaqus .inp, .vtu, .msh), base in
    the plane z = 0, apex below; or `published_heart`, the paper's mesh with its segments."""
    segments: FilePath | None = None
    """Table (CSV) with the columns `element` and `aha_segment`; not needed for a mesh with cell
    data `segment` (1-17), nor for `published_heart`."""
    unit: Unit = "mm"
    """Unit of the mesh's coordinates."""
    remesh: bool = True
    """Whether to mesh anew, with quadratic hexahedra (section `mesh`) between smooth surfaces
    fitted to the mesh's; otherwise its linear hexahedra are used as they are."""

    def check(self, key, study) -> Iterator[str]:
        if self.file is None:
            yield f"{key}.file: missing; source `mesh` needs a mesh, give its path"
        elif self.file != PUBLISHED_HEART:
            yield from missing_file(f"{key}.file", self.file)
            yield from missing_file(f"{key}.segments", self.segments)
        elif self.segments is not None:
            yield f"{key}.segments: {PUBLISHED_HEART} comes with its segments; remove it"


class OfMesh(Geometry):
    """A heart from a mesh."""

    source: Literal["mesh"]
    imported: Imported = Imported()


class BasePlane(Section):
    """The base plane, at which both surfaces are cut; null: the plane through the rims of surfaces
    that are open at the base."""

    point: Point = None
    """A point in the base plane, such as `[12.5, -40, 61]`."""
    normal: Direction | None = None
    """Normal of the base plane, away from the apex."""


class Insertions(Section):
    """Instead of `septum`, the two points where the right ventricle's wall meets the left
    ventricle, in one short-axis plane."""

    anterior: Point = None
    """The anterior one."""
    inferior: Point = None
    """The inferior one."""


class Surfaces(Section):
    """The two surfaces of source `surfaces`, in any right-handed frame that they share. Points and
    directions are in that frame."""

    endocardium: FilePath | None = None
    """Surface (STL, PLY, OBJ, VTP, legacy VTK), closed or open at the base alone."""
    epicardium: FilePath | None = None
    """As `endocardium`."""
    unit: Unit = "mm"
    """Unit of the surfaces' coordinates, and of the points below."""
    base: BasePlane = BasePlane()
    long_axis: Literal["apex", "base_normal"] = "apex"
    """Where the long axis leads from the middle of the base: `apex`, to the endocardial apex, or
    `base_normal`, along the normal of the base plane. Segments, fibres and the directions of
    strains follow it."""
    septum: Direction | None = None
    """Direction from the long axis towards the middle of the septum. Anterior is a quarter turn
    from there, counter-clockwise seen from the base, so a mirrored heart goes unnoticed;
    `insertions` show it."""
    insertions: Insertions = Insertions()

    def check(self, key, study) -> Iterator[str]:
        sides = {"endocardium": self.endocardium, "epicardium": self.epicardium}
        for side, path in sides.items():
            yield from missing_file(f"{key}.{side}", path)
            if path is None:
                yield (
                    f"{key}.{side}: missing; source `surfaces` needs both surfaces, give the path "
                    "of an STL, PLY, OBJ, VTP or VTK file"
                )
        if (self.base.point is None) != (self.base.normal is None):
            yield f"{key}.base: half of it is missing; give point and normal, or neither"
        given = [self.insertions.anterior is not None, self.insertions.inferior is not None]
        if any(given) and not all(given):
            yield f"{key}.insertions: one is missing; give anterior and inferior"
        elif (self.septum is None) != any(given):
            known = "unknown" if self.septum is None else "given twice"
            yield (
                f"{key}.septum: the septum's side is {known}; give the direction from the long "
                "axis to the septum's middle, or the two points of geometry.surfaces.insertions, "
                "and not both"
            )


class OfSurfaces(Geometry):
    """A heart from two surfaces."""

    source: Literal["surfaces"]
    surfaces: Surfaces = Surfaces()


AnyGeometry = Annotated[
    OfSegments | OfMesh | OfSurfaces,
    Field(discriminator="source"),
    by_default(source="segments"),
]


class Mesh(Section, reruns=GEOMETRY):
    """Quadratic hexahedra. Rows count elements along the wall within a level, outside the apex
    patch; mesh lines lie on segment borders."""

    circumferential: Literal[16, 24, 32, 40, 48] = 24
    """Elements around the ventricle."""
    basal: Count = 3
    """Rows in the basal level."""
    basal_grading: Share = 0.5
    """Height of each basal row relative to the one below it; under 1, finer to the base."""
    mid: Count = 2
    """Rows in the mid level."""
    apical: Count = 2
    """Rows in the apical level."""
    apex: Count = 2
    """Rows in the apex segment, between the apical level and the apex patch."""
    transmural: Count = 2
    """Elements through the wall."""


class Fibres(Section, reruns=GEOMETRY):
    """Rule-based directions, linear through the wall."""

    helix_endo_deg: Angle = 60.0
    """Helix angle of the fibres at the endocardium."""
    helix_epi_deg: Angle = -60.0
    """Helix angle of the fibres at the epicardium."""
    sheet_endo_deg: Angle = 45.0
    """Sheet angle at the endocardium."""
    sheet_epi_deg: Angle = -45.0
    """Sheet angle at the epicardium."""
    rotation_deg: Angle = 0.0
    """Added to the helix angle at the endocardium, taken from that at the epicardium, linear in
    between."""


def _pressure(value, info: ValidationInfo):
    """A pressure that waits to be filled in is one of the study's mistakes; the default serves to
    find the others, and nothing runs on it."""
    if value is None and isinstance(info.context, Reading):
        info.context.empty.append(f"loading.pressure_mmhg: empty; {NO_PRESSURE}")
        return Loading.model_fields["pressure_mmhg"].default
    return value


class Material(Section, reruns=MECHANICS):
    """The wall's material law and its reference, which theta = 1 stands for."""

    law: str = "holzapfel_ogden"
    """`holzapfel_ogden` (orthotropic, the paper's; constants of Wang et al. 2013) or `guccione`
    (transversely isotropic, exponential); others by a plugin."""
    constants: dict[Name, float] = {}
    """Constants of the law by name that differ from its reference values, such as `{a_f_kpa:
    15.0}`, each in the unit that its name ends with."""
    reference: dict[Name, float] = {}
    """By factor, what it is multiplied by everywhere, such as `{C_a: 0.3}`; the law has its own.
    Those of `holzapfel_ogden` were found by the rule `calibrate_reference` on volumes and mean
    strains of the published simulations."""
    bulk_modulus_kpa: Positive | None = None
    """Pressure per relative change of the wall's volume; null is an incompressible wall."""
    segment_factors: Annotated[
        dict[Annotated[str, Field(pattern=r"^([1-9]|1[0-7])$")], Positive],
        Note(names="use the number of an AHA segment, 1 to 17"),
    ] = {}
    """Multipliers of the stress by AHA segment (of the factor that all stresses are proportional
    to), such as `{7: 3.0}` for a stiff mid anterior segment."""


class Loading(Section, reruns=MECHANICS, added=LOADS.keys, extra="allow"):
    """Passive filling by a pressure on the endocardium."""

    __pydantic_extra__: dict[
        str, Annotated[float, Note(unit="mmHg"), Field(description="Size of a load of a plugin.")]
    ]

    pressure_mmhg: Annotated[float, Field(gt=0, le=60), BeforeValidator(_pressure)] = 8.0
    """End-diastolic pressure."""
    septal_pressure_mmhg: NonNegative = 0.0
    """Right-ventricular pressure on the epicardium of segments 2, 3, 8 and 9: a dead load along its
    normal in the unloaded state."""
    frames: list[Fraction] = []
    """Further load fractions, between 0 and 1 and rising, at which all quantities are observed,
    too; end diastole, 1, always is."""

    def check(self, key, study) -> Iterator[str]:
        if any(b <= a for a, b in itertools.pairwise(self.frames)):
            yield f"{key}.frames: {self.frames} does not rise; sort it and remove repetitions"


Place = Annotated[Annotated[str, WORD] | Annotated[Whole, OTHER], TEXT_OR_ELSE]

Held = Annotated[
    Annotated[Literal["held", "free"], WORD] | Annotated[NonNegative, OTHER],
    TEXT_OR_ELSE,
    Note(remedy="write `held`, `free`, or a compliance in mm/kPa"),
]


class BaseSupport(Section):
    """Components of the base's displacement, each `held`, `free`, or on springs with a compliance
    in mm/kPa (displacement per traction). The default is the paper's text; a rigid rotation that
    nothing holds is removed."""

    radial: Held = "held"
    """Away from the long axis: `held`, `free` or a compliance (mm/kPa)."""
    axial: Held = "held"
    """Along the long axis: `held`, `free` or a compliance (mm/kPa)."""
    circumferential: Held = "free"
    """Around the long axis: `held`, `free` or a compliance (mm/kPa)."""


class Supports(Section, reruns=MECHANICS, added=SUPPORTS.keys, extra="allow"):
    """How the ventricle is held where nothing loads it."""

    __pydantic_extra__: dict[
        str, Annotated[Any, Field(description="What a support of a plugin takes.")]
    ]

    base: BaseSupport = BaseSupport()
    epicardium_kpa_per_mm: NonNegative = 0.0
    """Stiffness of springs along the epicardium's normal in the unloaded state."""


class Observables(Section, reruns=MECHANICS):
    """What is observed of a ventricle, at end diastole and at `loading.frames`."""

    quantities: Annotated[list[str], Field(min_length=1), ONCE] = (
        "volume circumferential radial longitudinal".split()
    )
    """`volume` (mL), `circumferential`, `radial` and `longitudinal` strain of the segments,
    `torsion` (between two levels, deg/mm), `shortening` (of the long axis); others by a plugin."""
    places: dict[Name, Annotated[list[Place], Field(min_length=1), ONCE]] = {}
    """By quantity, the places that are observed where they are not all, AHA segments or pairs of
    levels (of torsion: not only `basal-apical`), such as `{longitudinal: [1, 4, 7, 10], torsion:
    [basal-apical, mid-apical]}`."""
    layer: Annotated[list[Part], Field(min_length=2, max_length=2)] = [0.0, 1.0]
    """Part of the wall over which strains are averaged: depths from and to, 0 at the endocardium
    and 1 at the epicardium; equal ones are a surface."""
    strain_exponent: Annotated[float, Field(ge=-4, le=4)] = 2.0
    """Strain measure, the exponent n of (stretch^n - 1) / n: 2 is Green's, 1 nominal (engineering),
    0 logarithmic, -2 Almansi's."""
    line_share: Part = 0.0
    """0: strains are components of the strain tensor; 1: those of the material line along the
    direction, which a tracked line shows; linear in between. Green's strain is the same."""
    unloaded_share: Part = 0.0
    """0: strains are along the circumferential, radial and longitudinal directions of the loaded
    wall; 1: along those of the unloaded wall, which turn with the tissue; linear in between."""
    segment_rotation_deg: Annotated[float, Field(ge=-30, le=30)] = 0.0
    """Angle by which the segments of the strains are turned against the wall, counter-clockwise
    seen from the base."""
    scale: dict[Name, Positive] = {}
    """By quantity, the factor of its measurement, such as `{radial: 0.8}`: below 1 for radial
    strain where tracking smooths the wall's thickening."""


class Solver(Section, reruns=MECHANICS):
    """Newton's method, load stepping and continuation in log theta."""

    increment_tolerance_mm: Positive = 1e-5
    """A Newton step with no displacement above this ends the iteration."""
    way_tolerance_mm: Positive = 1e-2
    """The same for intermediate states of a continuation."""
    tangent_tolerance_mm: Positive = 1e-3
    """Sensitivities come from a tangent factorised at most this far from the solution."""
    max_increment_mm: Positive = 50.0
    """A Newton step with a displacement above this ends the attempt as failed."""
    max_newton_steps: Count = 10
    """Newton steps per attempt."""
    first_load_fraction: Share = 0.02
    """First load step of an inflation from the unloaded state, as a fraction of the pressure."""
    min_load_fraction: Share = 1e-4
    """Load steps below this fraction of the pressure end the inflation as failed."""

    def check(self, key, study) -> Iterator[str]:
        if self.min_load_fraction > self.first_load_fraction:
            yield f"{key}.min_load_fraction: exceeds solver.first_load_fraction; lower it"


class Parameters(Section, reruns="everything but the geometry"):
    """What is inferred: in each zone of the wall some factors of the material law, 1 for the
    reference material."""

    zones: Annotated[
        Annotated[Literal["paper", "segments", "whole"], WORD]
        | Annotated[dict[Name, list[Whole]], OTHER],
        TEXT_OR_ELSE,
        Note(
            remedy="write `paper`, `segments` or `whole`, or give zones by name with their AHA "
            "segments"
        ),
    ] = "paper"
    """`paper` (five zones), `segments` (each AHA segment by itself), `whole` (one zone), or zones
    by name with their AHA segments, such as `{free: [1, 4, 5, 6, 7, 10, 11, 12], septal: [2, 3, 8,
    9], apical: [13, 14, 15, 16, 17]}`; every segment belongs to one of them."""
    factors: Annotated[list[str], Field(min_length=1), ONCE] | None = None
    """Factors of the material law that are inferred in every zone; null for all that it has."""
    bounds: dict[Name, Annotated[list[Positive], Field(min_length=2, max_length=2)]] = {}
    """Bounds by factor, such as `{C_a: [0.1, 5.0]}`, where they differ from `design.lower` and
    `design.upper`."""
