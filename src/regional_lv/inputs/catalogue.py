"""The catalogue: every input that the package knows, in the order of their vectors."""

from regional_lv.inputs import (
    closed_forms,
    fibres,
    material,
    observation,
    shape,
    stiffness,
    supports,
)
from regional_lv.registry import Registry

INPUTS = Registry(
    "input",
    "inputs",
    (
        stiffness.Stiffness,
        material.Anisotropy,
        material.SheetStiffness,
        material.ExponentRatio,
        material.FocalScar,
        material.Compressibility,
        shape.WallThickness,
        shape.SegmentThickness,
        shape.EndocardialRadius,
        shape.Length,
        shape.ApexThickness,
        shape.LevelEnd,
        closed_forms.Size,
        fibres.HelixEndo,
        fibres.HelixEpi,
        fibres.FibreRotation,
        fibres.SheetAngle,
        supports.SeptalLoad,
        supports.BasalMotion,
        supports.BasalAxial,
        supports.BasalTwist,
        supports.EpicardialSupport,
        closed_forms.EndDiastolicPressure,
        closed_forms.MixedFrames,
        observation.EndocardialSampling,
        observation.EpicardialSampling,
        observation.StrainMeasure,
        observation.LineStrain,
        observation.DirectionsOfStrain,
        observation.SegmentRotation,
        closed_forms.RadialScale,
        closed_forms.HeavyTails,
    ),
)
"""Name of a class of inputs -> the class."""
