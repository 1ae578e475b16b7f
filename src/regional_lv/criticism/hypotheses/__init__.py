"""The catalogue: what could be wrong with the base model. One file each, found by name."""

from regional_lv.criticism.hypotheses.anisotropy import Anisotropy
from regional_lv.criticism.hypotheses.basal_motion import BasalMotion
from regional_lv.criticism.hypotheses.base import (
    Hypothesis,
    NoiseHypothesis,
    ObservationHypothesis,
    SimulatorHypothesis,
    TransformHypothesis,
)
from regional_lv.criticism.hypotheses.compressibility import Compressibility
from regional_lv.criticism.hypotheses.end_diastolic_pressure import EndDiastolicPressure
from regional_lv.criticism.hypotheses.endocardial_sampling import EndocardialSampling
from regional_lv.criticism.hypotheses.epicardial_support import EpicardialSupport
from regional_lv.criticism.hypotheses.fibre_rotation import FibreRotation
from regional_lv.criticism.hypotheses.focal_scar import FocalScar
from regional_lv.criticism.hypotheses.heavy_tails import HeavyTails
from regional_lv.criticism.hypotheses.mixed_frames import MixedFrames
from regional_lv.criticism.hypotheses.radial_scale import RadialScale
from regional_lv.criticism.hypotheses.segment_rotation import SegmentRotation
from regional_lv.criticism.hypotheses.septal_load import SeptalLoad
from regional_lv.criticism.hypotheses.strain_measure import StrainMeasure
from regional_lv.criticism.hypotheses.wall_thickness import WallThickness

__all__ = [
    "REGISTRY",
    "Hypothesis",
    "NoiseHypothesis",
    "ObservationHypothesis",
    "SimulatorHypothesis",
    "TransformHypothesis",
    "asked",
]

REGISTRY: dict[str, Hypothesis] = {
    cls.name: cls()
    for cls in (
        EndDiastolicPressure,
        FibreRotation,
        BasalMotion,
        EndocardialSampling,
        StrainMeasure,
        SeptalLoad,
        EpicardialSupport,
        WallThickness,
        FocalScar,
        RadialScale,
        SegmentRotation,
        MixedFrames,
        Compressibility,
        Anisotropy,
        HeavyTails,
    )
}
"""Name (part of the contract with the findings) -> hypothesis."""


def asked(names: str | list[str], physics: dict) -> dict[str, Hypothesis]:
    """The hypotheses of `criticism.hypotheses`, with base and range as the study has them.

    Of `all`, those that the study's own model rules out are left out.
    """
    chosen = REGISTRY if names == "all" else {name: REGISTRY[name] for name in names}
    return {
        name: hypothesis.for_study(physics)
        for name, hypothesis in chosen.items()
        if not hypothesis.why_not(physics)
    }
