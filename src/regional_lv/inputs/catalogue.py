"""The catalogue: every input that the package knows, in the order of their vectors."""

from regional_lv.inputs.closed_forms import (
    EndDiastolicPressure,
    HeavyTails,
    MixedFrames,
    RadialScale,
    Size,
)
from regional_lv.inputs.fibres import FibreRotation, HelixEndo, HelixEpi, SheetAngle
from regional_lv.inputs.material import (
    Anisotropy,
    Compressibility,
    ExponentRatio,
    FocalScar,
    SheetStiffness,
)
from regional_lv.inputs.observation import (
    DirectionsOfStrain,
    EndocardialSampling,
    EpicardialSampling,
    LineStrain,
    SegmentRotation,
    StrainMeasure,
)
from regional_lv.inputs.shape import (
    ApexThickness,
    EndocardialRadius,
    Length,
    LevelEnd,
    SegmentThickness,
    WallThickness,
)
from regional_lv.inputs.stiffness import Stiffness
from regional_lv.inputs.supports import (
    BasalAxial,
    BasalMotion,
    BasalTwist,
    EpicardialSupport,
    SeptalLoad,
)
from regional_lv.registry import Registry

INPUTS = Registry(
    "input",
    "inputs",
    (
        Stiffness,
        Anisotropy,
        SheetStiffness,
        ExponentRatio,
        FocalScar,
        Compressibility,
        WallThickness,
        SegmentThickness,
        EndocardialRadius,
        Length,
        ApexThickness,
        LevelEnd,
        Size,
        HelixEndo,
        HelixEpi,
        FibreRotation,
        SheetAngle,
        SeptalLoad,
        BasalMotion,
        BasalAxial,
        BasalTwist,
        EpicardialSupport,
        EndDiastolicPressure,
        MixedFrames,
        EndocardialSampling,
        EpicardialSampling,
        StrainMeasure,
        LineStrain,
        DirectionsOfStrain,
        SegmentRotation,
        RadialScale,
        HeavyTails,
    ),
)
"""Name of a class of inputs -> the class."""
