"""Whether two surfaces of triangles bound the wall of one left ventricle that lines can cross.

Each check takes the paths of the two surfaces by side and the `triangulated.Ventricle`, and raises
InputError with the place, the AHA segment there, and the remedy.
"""

import numpy as np
import pandas as pd
import pyvista
from scipy.spatial import cKDTree

from regional_lv.aha import SEGMENTS
from regional_lv.errors import InputError
from regional_lv.geometry.fitted import aha_segment_at
from regional_lv.geometry.triangles import areas, cones, middles, triangle_points
from regional_lv.geometry.wall_lines import FAN

# Distance (mm) between the places at which the wall is looked at.
SPACING_MM = 2.5
# Share of a surface's area that lines may meet a second time.
FOLDED = 0.02
# A wall that is thicker (mm) than this over basal and mid level, and so many times thicker than on
# its thin side, has the right ventricle in it. Hypertrophied septa stay below one of the two.
RIGHT_VENTRICLE_MM, RIGHT_VENTRICLE_RATIO = 25.0, 3.0
# Sectors around the ventricle in which the wall's thickness is compared.
SECTORS = 12


def check_crossing(paths, heart):
    """The endocardium lies inside the epicardium everywhere."""
    places, beyond = overlap(heart.endocardium, heart.epicardium)
    worst = beyond.argmax()
    if beyond[worst] > 0:
        depth = places[worst] @ heart.base_normal
        raise InputError(
            f"{paths['endocardium']}: crosses {paths['epicardium']} by up to "
            f"{beyond[worst]:.2g} mm, farthest at {where(heart, places[worst])}, "
            f"{-depth:.3g} mm below the base; correct the surfaces there, or save both in one "
            "frame of coordinates"
        )


def check_one_ventricle(paths, heart):
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


def check_lines(paths, heart):
    """Every line through the wall meets each surface once, but for small folds."""
    for side, path in paths.items():
        surface = getattr(heart, side)
        corners = surface.points[surface.regular_faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        phi, u, _ = heart.lines.coordinates(middles(surface))
        crossing = np.einsum("nx,nx->n", normal, heart.lines.directions(phi, u))
        area = areas(surface)
        folded = np.sign(cones(surface).sum()) * crossing < 0
        share = area[folded].sum() / area.sum()
        if share > FOLDED:
            place = middles(surface)[folded][area[folded].argmax()]
            raise InputError(
                f"{path}: {100 * share:.0f} % of the surface is hidden from the long axis by "
                f"another part of it, such as the part at {where(heart, place)}, and cannot be "
                "meshed; smooth the surface, leave papillary muscles and trabeculae to the cavity, "
                "or correct the base plane"
            )


def where(heart, point):
    """A point (3,) in the files' coordinates and in words: its AHA segment."""
    phi, u, _ = heart.lines.coordinates(point[None])
    segment = SEGMENTS[aha_segment_at(phi[0], u[0]) - 1]
    return f"{heart.in_file_words(point)} (segment {segment.number}, {segment.name})"


def overlap(endocardium, epicardium):
    """Places (n, 3) on both surfaces, and how far (n,) mm each lies on the wrong side of the other;
    less than 0 where there is a wall."""
    inner, outer = (triangle_points(s, SPACING_MM) for s in (endocardium, epicardium))
    beyond = [_outside(inner, epicardium), -_outside(outer, endocardium)]
    return np.concatenate([inner, outer]), np.concatenate(beyond)


def _outside(points, surface):
    """How far (n,) mm the points lie outside a surface; less than 0 inside."""
    found = pyvista.PolyData(points).compute_implicit_distance(surface)["implicit_distance"]
    return np.sign(cones(surface).sum()) * found
