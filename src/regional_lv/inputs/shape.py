"""Inputs of the shape: how thick the wall is, how wide and how long the cavity."""

from collections.abc import Mapping
from typing import ClassVar

from regional_lv.geometry.shape import LEVEL_KEYS
from regional_lv.geometry.table import SD_COLUMNS, plausible_mm
from regional_lv.inputs.base import LOGARITHMIC, KeyInput, SegmentInput
from regional_lv.inputs.scales import Linear

KAWEL = "Kawel et al. 2012, Circ Cardiovasc Imaging 5:500-508, doi 10.1161/CIRCIMAGING.112.973560"


NO_TABLE = "no_table"
"""Key of a model's section `geometry`: why no segment table describes the heart."""


def is_of_table(word: str, given: str | Mapping) -> bool:
    """Whether a word of the section `inputs`, and what is `given` for it, stand for a figure of a
    segment table."""
    kinds = (SegmentThickness, EndocardialRadius, Length, ApexThickness, LevelEnd)
    stems = {SegmentThickness.stem, EndocardialRadius.name}
    of_kind = word in {TableInput.family, *LEVEL_KEYS, *(kind.name for kind in kinds)}
    # By itself it is the scale of the whole wall, unless it has a standard deviation in mm.
    of_kind |= word == SegmentThickness.stem and f"sd_{TableInput.unit}" in given
    return of_kind or word.rpartition("_")[0] in stems


class TableInput(SegmentInput):
    """One value of the segment table's column `column`, from `less` to `more` times its own."""

    family = "shape"
    changes = "geometry"
    is_cause = False
    unit = "mm"
    scale = LOGARITHMIC
    column: ClassVar[str]
    less, more = 0.75, 1.3
    step = 1e-5  # surfaces are found to 1e-8 of their figures

    @classmethod
    def why_not(cls, model):
        geometry = model["geometry"]
        if cls.column in geometry:
            return ""
        return geometry.get(NO_TABLE, "the heart is not made from a segment table")

    def value_in(self, model):
        return float(model["geometry"][self.column][self.segment - 1])

    def known_sd(self, model):
        table = model["geometry"]["table"]
        sds = table.get(SD_COLUMNS[self.column])
        return float(sds[self.segment - 1]) if sds is not None and sds[self.segment - 1] else None

    def _set_nominal(self, value):
        least, most = plausible_mm(self.column, self.segment)
        self.nominal = value
        self.low, self.high = max(self.less * value, least), min(self.more * value, most)

    def act(self, model, value):
        geometry = model["geometry"]
        values = geometry[self.column].copy()
        values[self.segment - 1] = value
        return {**model, "geometry": {**geometry, self.column: values}}


class SegmentThickness(TableInput):
    """One segment, where `WallThickness` has the whole wall."""

    name, stem = "segment_thickness", "wall_thickness"
    column = "wall_thickness_mm"
    parameter = "wall thickness of one segment"
    description = (
        "The mean thickness of one segment's wall, read off slices of finite depth between borders "
        "that observers draw differently: a millimetre in ten."
    )
    source = KAWEL

    @property
    def words(self):
        return (*super().words, self.stem)


class EndocardialRadius(TableInput):
    name = "endo_radius"
    column = "endo_radius_mm"
    parameter = "endocardial radius of one segment"
    description = (
        "The mean distance of one segment's endocardium from the long axis. Trabeculae and "
        "papillary muscles blur this border by a millimetre or two."
    )
    source = "Childs et al. 2011, J Cardiovasc Magn Reson 13:40, doi 10.1186/1532-429X-13-40"


class WallThickness(KeyInput):
    name = "wall_thickness"
    family = "shape"
    path = ("geometry", "wall_thickness_scale")
    parameter = "scale of the wall thickness"
    low, high = 0.75, 1.25
    scale = LOGARITHMIC
    moves = tuple(f"{SegmentThickness.stem}_{segment}" for segment in range(1, 18))
    carries = True
    description = (
        "Wall thickness is measured on slices of finite depth, with a border between muscle, fat "
        "and trabeculae that observers draw differently. Multiplies it everywhere, with the "
        "endocardium as it is: a thicker wall strains less, while the cavity hardly changes."
    )
    source = KAWEL

    def carry(self, other, there, value):
        share = value / self.nominal
        return share * there, share, there / self.nominal


class Length(KeyInput):
    name = "length"
    is_cause = False
    family = "shape"
    path = ("geometry", "length_mm")
    parameter = "length of the cavity from the base to the endocardial apex"
    unit = "mm"
    scale = LOGARITHMIC
    description = (
        "The cavity's length along its axis; levels of the segments and the epicardial apex go "
        "along. The base plane is set by hand on long-axis images, to a slice or two."
    )
    source = "Childs et al. 2011, J Cardiovasc Magn Reson 13:40, doi 10.1186/1532-429X-13-40"
    less, more = 0.85, 1.15

    @classmethod
    def why_not(cls, model):
        return SegmentThickness.why_not(model)

    def _set_nominal(self, value):
        self.nominal, self.low, self.high = value, self.less * value, self.more * value


class ApexThickness(Length):
    name = "apex"
    path = ("geometry", "apex_mm")
    parameter = "thickness of the wall at the apex"
    description = (
        "The distance of the epicardial from the endocardial apex. The wall is thinnest there, and "
        "images cut it obliquely."
    )
    source = "Bradfield, Beck and Vecht 1977, Br Heart J 39:806-809 (the thin point of the apex)"
    less, more = 0.6, 1.4


class LevelEnd(KeyInput):
    """One for each border between two levels of segments."""

    name = "level_end"
    is_cause = False
    family = "shape"
    changes = "geometry"
    scale = Linear()
    description = (
        "Where a level of segments ends, as a share of the cavity's length from the base plane. "
        "Levels lie where slices were put; segments, with their stiffness and what is observed of "
        "them, are then other parts of the wall."
    )
    source = "Cerqueira et al. 2002, Circulation 105:539-542, doi 10.1161/hc0402.102975 (thirds)"
    reach = 0.05

    def __init__(self, model, key):
        self.name, self.path = key, ("geometry", key)
        self.parameter = f"end of the {key.removesuffix('_end')} level"
        super().__init__(model)

    @classmethod
    def why_not(cls, model):
        return SegmentThickness.why_not(model)

    @classmethod
    def members(cls, model):
        return () if cls.why_not(model) else [cls(model, key) for key in LEVEL_KEYS]

    def _set_nominal(self, value):
        self.nominal, self.low, self.high = value, value - self.reach, value + self.reach
