"""The catalogue: what could be wrong with the base model. One file each, found by name."""

from collections.abc import Mapping

from regional_lv.criticism.hypotheses.anisotropy import Anisotropy
from regional_lv.criticism.hypotheses.basal_axial import BasalAxial
from regional_lv.criticism.hypotheses.basal_motion import BasalMotion
from regional_lv.criticism.hypotheses.basal_twist import BasalTwist
from regional_lv.criticism.hypotheses.base import (
    REGISTRY,
    Hypothesis,
    LoadHypothesis,
    NoiseHypothesis,
    ObservationHypothesis,
    ReportHypothesis,
    SimulatorHypothesis,
)
from regional_lv.criticism.hypotheses.compressibility import Compressibility
from regional_lv.criticism.hypotheses.end_diastolic_pressure import EndDiastolicPressure
from regional_lv.criticism.hypotheses.endocardial_sampling import EndocardialSampling
from regional_lv.criticism.hypotheses.epicardial_sampling import EpicardialSampling
from regional_lv.criticism.hypotheses.epicardial_support import EpicardialSupport
from regional_lv.criticism.hypotheses.exponent_ratio import ExponentRatio
from regional_lv.criticism.hypotheses.fibre_rotation import FibreRotation
from regional_lv.criticism.hypotheses.focal_scar import FocalScar
from regional_lv.criticism.hypotheses.heavy_tails import HeavyTails
from regional_lv.criticism.hypotheses.helix_endo import HelixEndo
from regional_lv.criticism.hypotheses.helix_epi import HelixEpi
from regional_lv.criticism.hypotheses.line_strain import LineStrain
from regional_lv.criticism.hypotheses.mixed_frames import MixedFrames
from regional_lv.criticism.hypotheses.radial_scale import RadialScale
from regional_lv.criticism.hypotheses.segment_rotation import SegmentRotation
from regional_lv.criticism.hypotheses.septal_load import SeptalLoad
from regional_lv.criticism.hypotheses.sheet_angle import SheetAngle
from regional_lv.criticism.hypotheses.sheet_stiffness import SheetStiffness
from regional_lv.criticism.hypotheses.strain_measure import StrainMeasure
from regional_lv.criticism.hypotheses.wall_thickness import WallThickness

__all__ = [
    "REGISTRY",
    "Hypothesis",
    "LoadHypothesis",
    "NoiseHypothesis",
    "ObservationHypothesis",
    "ReportHypothesis",
    "SimulatorHypothesis",
    "asked",
]

for hypothesis in (
    EndDiastolicPressure,
    FibreRotation,
    HelixEndo,
    HelixEpi,
    SheetAngle,
    BasalMotion,
    BasalAxial,
    BasalTwist,
    EndocardialSampling,
    EpicardialSampling,
    StrainMeasure,
    LineStrain,
    SeptalLoad,
    EpicardialSupport,
    WallThickness,
    FocalScar,
    RadialScale,
    SegmentRotation,
    MixedFrames,
    Compressibility,
    Anisotropy,
    SheetStiffness,
    ExponentRatio,
    HeavyTails,
):
    REGISTRY.add(hypothesis())


def asked(names: str | list[str], physics: Mapping) -> dict[str, Hypothesis]:
    """The hypotheses of `criticism.hypotheses`, with base and range as the study has them.

    Of `all`, those that the study's own model rules out are left out. Raises InputError for a name
    that is not in the catalogue.
    """
    chosen = REGISTRY if names == "all" else {name: REGISTRY[name] for name in names}
    return {
        name: hypothesis.for_study(physics)
        for name, hypothesis in chosen.items()
        if not hypothesis.why_not(physics)
    }
