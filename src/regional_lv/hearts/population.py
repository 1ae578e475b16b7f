"""Plausible left ventricles, as segment tables: what an emulator of any heart has to know.

Lengths are shares of the cavity's length, since a ventricle that is scaled as a whole is known from
its own shape. Ranges are wider than the population's: at end diastole 1,991 volunteers of MESA
(Cardiac Atlas Project) have walls of 0.08 to 0.14 and radii of 0.23 to 0.30 of the length, twelve
of them early in diastole, at the mid level, 0.15 to 0.28 and 0.21 to 0.32; the paper's volunteer
0.10 to 0.18 and 0.23 to 0.38. Walls of infarcts are thinned to 4 mm and less
(Shah et al. 2013, doi 10.1001/jama.2013.1381), those of hypertrophic hearts are 15 to 30 mm thick
at their thickest (Elliott et al. 2014, doi 10.1093/eurheartj/ehu284), dilated hearts are two thirds
as wide as long and wider (Lang et al. 2015, doi 10.1016/j.echo.2014.10.003).
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np
import pandas as pd
from scipy.stats import norm

from regional_lv.aha import LEVELS, SEGMENTS
from regional_lv.errors import InputError
from regional_lv.geometry.shape import LEVEL_KEYS, heights, level_ends
from regional_lv.geometry.surfaces import QUARTER, Surfaces
from regional_lv.inputs.shape import ApexThickness, EndocardialRadius, SegmentThickness
from regional_lv.simulation.sobol import sobol

HEART = "heart"
"""Column of a design that says what kind of ventricle a row is."""

KINDS = {
    "plain": (0.40, (0.075, 0.22), (0.20, 0.42)),
    "infarct": (0.25, (0.075, 0.18), (0.22, 0.45)),
    "hypertrophied": (0.17, (0.15, 0.30), (0.18, 0.36)),
    "dilated": (0.18, (0.055, 0.12), (0.30, 0.50)),
}
"""Kind of ventricle -> its share of the draws, and the ranges of its mean wall thickness and of its
endocardial radius where the cavity is widest, in shares of its length."""

THICKNESS, RADIUS = (0.036, 0.42), (0.10, 0.62)
"""No segment's wall is thinner or thicker, none is narrower or wider at its widest."""

LEVEL_EFFECTS = {
    "wall_thickness": {"basal": (-0.40, 0.30), "apical": (-0.40, 0.15), "apex": (-0.60, 0.10)},
    "endo_radius": {"basal": (-0.30, 0.15), "apical": (-0.25, 0.20), "apex": (-0.25, 0.35)},
}
"""Logarithms of what a level has beside the mid level."""

AROUND = {"wall_thickness": (0.18,), "endo_radius": (0.28, 0.05)}
"""Amplitudes, of the logarithm, of one wave around the axis, two, ...; each as cosine and sine: the
septum is thinner or thicker than the free wall, and nearer to the axis."""

AROUND_A_LEVEL = {"wall_thickness": 0.17, "endo_radius": 0.15}
"""The same of one wave that a level has by itself: the axis and the septum are not straight."""

SINGLE_SD = {"wall_thickness": 0.07, "endo_radius": 0.025}
"""Standard deviation, of the logarithm, of each segment by itself, and of how well it is read; in
twelve volunteers 0.036, and 0.009 to 0.025."""

MOST_SD = 2.5
"""Of them, at most."""

APEX = (-0.6, 0.2)
"""Logarithm of the wall's thickness at the apex beside that of segment 17."""

LEVEL_ENDS = {"basal_end": (0.15, 0.38), "mid_end": (0.54, 0.72)}
"""Where levels end, in shares of the length; the AHA's thirds and slices of other depths."""

APICAL_LEVEL, APICAL_END = (0.12, 0.26), 0.93
"""Length of the apical level, and where it ends at the latest."""

INFARCT = (0.036, 0.072)
"""Thickness of an infarct's wall."""

BULGE = 0.12
"""An infarct bulges, to this logarithm of the radius at most."""

THICKENED = (1.1, 1.8)
"""A hypertrophied wall is as many times thicker in some neighbouring segments."""

MOST_NEIGHBOURS = {"infarct": 3, "hypertrophied": 5}
"""Segments that are thinned or thickened together."""

THINNEST = 0.15
"""Share of the thinnest segment's mean that the wall has everywhere."""

SHAPE = {
    SegmentThickness.column: [f"{SegmentThickness.stem}_{s.number}" for s in SEGMENTS],
    EndocardialRadius.column: [f"{EndocardialRadius.name}_{s.number}" for s in SEGMENTS],
}
"""Columns of the segment table -> names of their inputs."""

COLUMNS = (*chain(*SHAPE.values()), ApexThickness.name, *LEVEL_KEYS)
"""Names of the inputs that are drawn."""

WAVING = [level for level in LEVELS if len(LEVELS[level]) > 1]

DIMENSIONS = 1 + 2 * (1 + 3 + 2 + 2 * len(WAVING) + len(SEGMENTS)) + 2 + 1 + 4 + 3


class SegmentAngles:
    """Angles of a segment table, which all shapes share.

    Attributes: table; length (mm); angle (17,), of the segments' middles (rad); nearest (17, 17),
    of each segment the others in the order of their distance on the bullseye, itself first.
    """

    def __init__(self, table: pd.DataFrame, length_mm: float):
        self.table, self.length = table, length_mm
        top, bottom = self._latitudes(level_ends(table, length_mm))
        self.angle = np.radians((table["angle_from_deg"] + table["angle_to_deg"]).to_numpy() / 2)
        rho = 1 - (top + bottom) / 2 / QUARTER
        rho[-1] = 0.0
        place = rho * np.exp(1j * self.angle)
        self.nearest = np.abs(place[:, None] - place).argsort(axis=1, kind="stable")

    def _latitudes(self, ends: Mapping[str, float]) -> list[np.ndarray]:
        """Of the top and the bottom of the segments (17,), where levels end as `ends` say."""
        of_shape = heights({**ends, "length_mm": self.length})
        return [np.arcsin(np.clip(-z / self.length, 0, 1)) for z in of_shape.values()]

    def cosine(self, ends: Mapping[str, float]) -> np.ndarray:
        """Mean cosine (17,) of the segments' latitudes, by which a radius is smaller than where the
        cavity is widest."""
        top, bottom = self._latitudes(ends)
        return (np.sin(bottom) - np.sin(top)) / (bottom - top)

    def table_of(self, shape: np.ndarray) -> pd.DataFrame:
        """The segment table of a shape, in the order of `COLUMNS`."""
        values = dict(zip(COLUMNS, shape, strict=True))
        columns = {column: [values[name] for name in names] for column, names in SHAPE.items()}
        ends = {name: values[name] for name in LEVEL_KEYS}
        return self.table.assign(**columns, **heights({**ends, "length_mm": self.length}))


def draw(table: pd.DataFrame, length_mm: float, n: int, seed: int) -> pd.DataFrame:
    """Shapes of n ventricles of this length (mm), with the angles of a segment table.

    Columns: `HEART`, a word of `KINDS`, and `COLUMNS` (mm, shares of the length). The first of more
    are the same. Shapes through which no smooth surfaces go, or whose wall gets too thin between
    its segments' means, are left out, and later ones of the sequence move up.
    """
    angles = SegmentAngles(table, length_mm)
    found: list[tuple] = []
    for kind, shape in _candidates(angles, n, seed):
        if len(found) == n:
            break
        if is_smooth(angles, shape):
            found.append((kind, *shape))
    return pd.DataFrame(found, columns=[HEART, *COLUMNS])


def is_smooth(angles: SegmentAngles, shape: np.ndarray) -> bool:
    """Whether smooth surfaces go through a shape, with a wall between them everywhere."""
    end, at_apex = -angles.length, shape[COLUMNS.index(ApexThickness.name)]
    try:
        surfaces = Surfaces(angles.table_of(shape), end, end - at_apex, sharp=True)
    except InputError:
        return False
    phi, u = (each.ravel() for each in np.meshgrid(np.arange(72) / 36 * np.pi, _LATITUDES))
    thinnest = min(shape[: len(SEGMENTS)].min(), at_apex)
    return bool(surfaces.thickness(phi, u).min() > THINNEST * thinnest)


_LATITUDES = np.linspace(0, QUARTER, 25)


def _candidates(angles: SegmentAngles, n: int, seed: int) -> Iterator[tuple[str, np.ndarray]]:
    """Kind and shape of one ventricle after the other."""
    first, count = 0, max(n, 1)
    while True:
        points = sobol(first + count, np.zeros(DIMENSIONS), np.ones(DIMENSIONS), "natural", seed)
        for u in points[first:]:
            yield _shape(angles, u)
        first, count = first + count, first + count


def _shape(angles: SegmentAngles, u: np.ndarray) -> tuple[str, np.ndarray]:
    """Kind and shape of uniform numbers (DIMENSIONS,)."""
    numbers = iter(u)
    shares = np.cumsum([share for share, *_ in KINDS.values()])
    kind = list(KINDS)[np.searchsorted(shares[:-1], next(numbers), side="right")]
    logs = {}
    for what, means in zip(LEVEL_EFFECTS, KINDS[kind][1:], strict=True):
        log = np.full(len(SEGMENTS), _between(np.log(means).tolist(), next(numbers)))
        for level, effect in LEVEL_EFFECTS[what].items():
            log[[s - 1 for s in LEVELS[level]]] += _between(effect, next(numbers))
        for waves, amplitude in enumerate(AROUND[what], start=1):
            cosine, sine = (_between((-amplitude, amplitude), next(numbers)) for _ in "cs")
            angle = waves * angles.angle[:-1]
            log[:-1] += cosine * np.cos(angle) + sine * np.sin(angle)
        own = AROUND_A_LEVEL[what]
        for level in WAVING:
            segments = [s - 1 for s in LEVELS[level]]
            cosine, sine = (_between((-own, own), next(numbers)) for _ in "cs")
            angle = angles.angle[segments]
            log[segments] += cosine * np.cos(angle) + sine * np.sin(angle)
        single = norm.ppf([next(numbers) for _ in SEGMENTS])
        log += SINGLE_SD[what] * np.clip(single, -MOST_SD, MOST_SD)
        logs[what] = log
    apex, where, many, size, bulge = (next(numbers) for _ in range(5))
    ends = {name: _between(pair, next(numbers)) for name, pair in LEVEL_ENDS.items()}
    low, high = APICAL_LEVEL
    high = min(high, APICAL_END - ends["mid_end"])
    ends["apical_end"] = ends["mid_end"] + _between((low, high), next(numbers))
    thickness, radius = np.exp(logs["wall_thickness"]), np.exp(logs["endo_radius"])
    if kind in MOST_NEIGHBOURS:
        count = 1 + int(many * MOST_NEIGHBOURS[kind])
        near = angles.nearest[int(where * len(SEGMENTS))][:count]
        if kind == "infarct":
            thickness[near] = np.minimum(thickness[near], _between(INFARCT, size))
            radius[near] *= np.exp(_between((0.0, BULGE), bulge))
        else:
            thickness[near] *= _between(THICKENED, size)
    thickness, radius = np.clip(thickness, *THICKNESS), np.clip(radius, *RADIUS)
    at_apex = np.clip(thickness[-1] * np.exp(_between(APEX, apex)), *THICKNESS)
    sizes = np.concatenate([thickness, angles.cosine(ends) * radius, [at_apex]])
    return kind, np.concatenate([angles.length * sizes, [ends[name] for name in LEVEL_KEYS]])


def _between(ends: Sequence[float], share: float) -> float:
    low, high = ends
    return low + share * (high - low)
