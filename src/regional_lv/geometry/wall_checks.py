"""Whether two surfaces of triangles bound the wall of one left ventricle that lines can cross.

Each check takes the paths of the two surfaces by side and the `ventricle.Ventricle`, and raises
InputError with the place, the AHA segment there, and the remedy.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from regional_lv.aha import SEGMENTS
from regional_lv.errors import InputError
from regional_lv.geometry.fitted import aha_segment_at
from regional_lv.geometry.surfaces import QUARTER
from regional_lv.geometry.triangles import areas, cones, middles, triangle_points
from regional_lv.geometry.ventricle import Ventricle
from regional_lv.geometry.wall_lines import FAN

# Distance (mm) between the places at which the wall is looked at.
SPACING_MM = 2.5
# Share of a surface's area that lines may meet a second time, and the cosine between its normal
# and the line from which on it counts: treads of steps between slices lie along the lines.
FOLDED, OVERHANGING = 0.05, -0.3
# A wall that is thicker (mm) than this over basal and mid level, and so many times thicker than on
# its thin side, has the right ventricle in it. Hypertrophied septa stay below one of the two.
RIGHT_VENTRICLE_MM, RIGHT_VENTRICLE_RATIO = 25.0, 3.0
# Thinnest wall (mm) that is meshed, and thinnest that is left at a base that is moved.
THINNEST_MM, RIM_MM = 0.5, 1.0
# Places around and along at which the wall between smooth surfaces is looked at.
PLACES = (121, 61)
# Sectors around the ventricle in which the wall's thickness is compared.
SECTORS = 12


def check_one_ventricle(paths: Mapping[str, Path], heart: Ventricle) -> None:
    """The epicardium is that of the left ventricle alone."""
    inner, outer = (
        triangle_points(surface, SPACING_MM) for surface in (heart.endocardium, heart.epicardium)
    )
    phi, u, _ = heart.lines.coordinates(outer)
    thickness = pd.Series(cKDTree(inner).query(outer)[0])[np.sin(u) < FAN]
    around = thickness.groupby(np.floor((phi[thickness.index] / np.pi + 1) * SECTORS / 2))
    typical = around.median()
    if typical.max() > max(RIGHT_VENTRICLE_MM, RIGHT_VENTRICLE_RATIO * typical.min()):
        place = outer[around.idxmax()[typical.idxmax()]]
        raise InputError(
            f"{paths['epicardium']}: seems to hold the right ventricle too: the wall is "
            f"{typical.max():.0f} mm thick on the side of {where(heart, place)} and "
            f"{typical.min():.0f} mm at its thinnest; give the epicardium of the left ventricle "
            "alone, which runs between the ventricles along the right side of the septum"
        )


def check_lines(paths: Mapping[str, Path], heart: Ventricle) -> None:
    """Every line through the wall meets each surface once, but for small folds."""
    for side, path in paths.items():
        surface = getattr(heart, side)
        corners = surface.points[surface.regular_faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        phi, u, _ = heart.lines.coordinates(middles(surface))
        along = heart.lines.directions(phi, u)
        cosine = np.einsum("nx,nx->n", normal, along) * np.sign(cones(surface).sum())
        size, area = np.linalg.norm(along, axis=1), areas(surface)
        folded = cosine < OVERHANGING * 2 * area * size
        share = area[folded].sum() / area.sum()
        if share > FOLDED:
            place = middles(surface)[folded][area[folded].argmax()]
            raise InputError(
                f"{path}: {100 * share:.0f} % of the surface is hidden from the long axis by "
                f"another part of it, such as the part at {where(heart, place)}, and cannot be "
                "meshed; smooth the surface, leave papillary muscles and trabeculae to the cavity, "
                "or correct the base plane"
            )


def where(heart: Ventricle, point: np.ndarray) -> str:
    """A point (3,) in the files' coordinates and in words: its AHA segment."""
    phi, share = np.arctan2(point[1], point[0]), -point[2] / heart.lines.length
    segment = SEGMENTS[aha_segment_at(phi, share) - 1]
    return f"{heart.in_file_words(point)} (segment {segment.number}, {segment.name})"


def depth_of_crossing(heart: Ventricle, deepest: float) -> float:
    """How far (mm) below the base the surfaces cross or nearly do, if no deeper than `deepest`;
    otherwise 0."""
    inner, thickness = _wall(heart)
    depth, crossing = -inner @ heart.base_normal, thickness < THINNEST_MM
    if not crossing.any() or depth[crossing].max() > deepest:
        return 0.0
    # The first row of places (rows, angles) below which there is a wall all around.
    rows = (thickness < RIM_MM) & (depth < deepest)
    return depth.reshape(PLACES[::-1])[np.flatnonzero(rows)[-1] // PLACES[0] + 1].max()


def check_thickness(paths: Mapping[str, Path], heart: Ventricle) -> None:
    """There is a wall between the smooth surfaces through the endocardium and the epicardium."""
    inner, thickness = _wall(heart)
    least = thickness.argmin()
    if thickness[least] > THINNEST_MM:
        return
    place = (
        f"at {where(heart, inner[least])}, {-inner[least] @ heart.base_normal:.3g} mm below the "
        "base"
    )
    if thickness[least] < 0:
        raise InputError(
            f"{paths['endocardium']}: crosses {paths['epicardium']} by up to "
            f"{-thickness[least]:.2g} mm, farthest {place}; correct the surfaces there, or save "
            "both in one frame of coordinates"
        )
    raise InputError(
        f"{paths['endocardium']}: lies {thickness[least]:.2g} mm inside {paths['epicardium']} "
        f"{place}; the wall must be at least {THINNEST_MM} mm thick: correct the surfaces there"
    )


def _wall(heart: Ventricle) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) all over the endocardium, and the wall's thickness (n,) in mm along the lines
    there; less than 0 where the epicardium lies inside."""
    angles, latitudes = np.linspace(-np.pi, np.pi, PLACES[0]), np.linspace(0, QUARTER, PLACES[1])
    phi, u = (grid.ravel() for grid in np.meshgrid(angles, latitudes))
    length = np.linalg.norm(heart.lines.directions(phi, u), axis=1)
    inner, outer = (smooth.distance(phi, u) for smooth in heart.smooth.values())
    return heart.lines.points(phi, u, inner), (outer - inner) * length
