"""Endocardium and epicardium as two triangulated surfaces from elsewhere: read, checked, cut at the
base, and moved into the project's frame.

The files' frame may be any right-handed one (a scanner's, say) as long as both share it. The z axis
is the long axis, from the middle of the endocardium's opening in the base plane, the origin, away
from the apex; the base plane may be oblique to it. The middle of the septum comes to lie at
`fitted.SEPTUM_DEG`. Lengths below are in mm; what an error names is in the files' own coordinates.

Which side of the septum is anterior follows from handedness: seen from the base, anterior is 90
degrees counter-clockwise from the septum's middle. The septum's direction alone cannot tell a heart
from its mirror image (an axis flipped on export); the two insertions of the right ventricle can.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyvista
from scipy.spatial import cKDTree

from regional_lv.errors import InputError
from regional_lv.geometry import wall_checks
from regional_lv.geometry.fitted import SEPTUM_DEG
from regional_lv.geometry.imported import (
    MM_PER,
    PLAUSIBLE_LENGTH_MM,
    UNIT_NAMES,
    surrounds_axis,
    units_that_fit,
)
from regional_lv.geometry.surface_files import read_surface
from regional_lv.geometry.triangles import areas, enclosed_volume, middles
from regional_lv.geometry.ventricle import Ventricle, place_words

log = logging.getLogger(__name__)

KEY = "geometry.surfaces"

# What lies closer to the base plane than this share of the surface's length lies in it.
FLATNESS = 1e-3
# How far (mm) the rim of a base-cut surface may be from the base plane, and what is reported.
UNEVEN_MM = 5.0
NOTABLE_MM = 1.0
# Share of a surface's area that may lie above the base plane: more, and its normal is turned round.
LARGEST_SHARE_ABOVE = 0.7
# Angles (deg) between the long axis and the line from the base's middle to the apex.
NOTABLE_TILT_DEG, LARGEST_TILT_DEG = 15.0, 35.0
# The apex is sought below this share of the greatest depth, and is what is farther from the base's
# middle than this share of the greatest distance.
DEEP, FAR = 0.8, 0.98
# Smallest angle (deg) between the septum's direction and the long axis.
SMALLEST_SEPTUM_DEG = 20.0
# Largest distance (mm) of an insertion from the epicardium, and smallest arc (deg) between two.
INSERTION_MM = 20.0
SMALLEST_SEPTUM_ARC_DEG = 30.0


def read_ventricle(
    endocardium: str | Path,
    epicardium: str | Path,
    unit: str = "mm",
    base: Mapping | None = None,
    septum: Sequence[float] | None = None,
    insertions: Mapping | None = None,
    long_axis: str = "apex",
) -> Ventricle:
    """`Ventricle` from two files of triangles (STL, PLY, OBJ, VTP or legacy VTK).

    Parameters
    ----------
    endocardium, epicardium: paths. Each surface is closed, or open at the base alone.
    unit: of the files' coordinates (a key of `MM_PER`), and of all points below.
    base: `point` (3,) in the base plane and `normal` (3,), which points away from the apex; both
        None, or `base` None: the plane through the rims of two surfaces that are open at the base.
    septum: direction (3,) from the long axis towards the middle of the septum.
    insertions: instead of it, the points `anterior` and `inferior` (3,) where the right ventricle's
        wall meets the left ventricle, in any short-axis plane.
    long_axis: where the long axis leads from the middle of the base, `apex` (of the endocardium) or
        `base_normal` (against the base's normal).

    Raises
    ------
    InputError: with the file, the place and the remedy.
    """
    paths = {"endocardium": Path(endocardium), "epicardium": Path(epicardium)}
    mm = MM_PER[unit]
    given = {side: _read(path) for side, path in paths.items()}
    for surface in given.values():
        surface.points *= mm
    _check_lengths(paths, given, unit)
    _check_together(paths, given, mm)
    point, normal = _base_plane(paths, given, base or {}, mm)
    across = np.eye(3)[np.abs(normal).argmin()]
    rotation = _axes(normal, across - across @ normal * normal, 0.0)

    def placed(point: np.ndarray) -> Ventricle:
        return _placed(paths, given, point, rotation, mm, septum, insertions, long_axis)

    heart = placed(point)
    depth = wall_checks.depth_of_crossing(heart, UNEVEN_MM)
    if depth > 0:
        log.warning(
            "The surfaces cross each other at their rims; the base plane is moved %.1f mm towards "
            "the apex, below that",
            depth,
        )
        heart = placed(heart.origin - depth * normal)
    wall_checks.check_thickness(paths, heart)
    return heart


def read_configured(
    endocardium: str | Path, epicardium: str | Path, surfaces: Mapping
) -> Ventricle:
    """`read_ventricle` of two paths with what the section `geometry.surfaces` says of them; other
    keys of it are not used."""
    wanted = ("unit", "base", "septum", "insertions", "long_axis")
    said = {key: surfaces[key] for key in wanted if key in surfaces}
    return read_ventricle(endocardium, epicardium, **said)


def _placed(
    paths: Mapping[str, Path],
    given: Mapping[str, pyvista.PolyData],
    point: np.ndarray,
    rotation: np.ndarray,
    mm: float,
    septum: Sequence[float] | None,
    insertions: Mapping | None,
    long_axis: str,
) -> Ventricle:
    """`Ventricle` below the base plane through a point (3,), `rotation` having its normal as z."""
    (inner, outer), origin = _cut_at_base(paths, given, point, rotation, mm)
    heart = Ventricle(inner, outer, rotation, origin, mm, np.array([0.0, 0.0, 1.0]))
    _check_inside(paths, heart)
    apex = _apex(heart)
    _check_tilt(heart, apex)
    if long_axis == "apex":
        upwards = -apex / np.linalg.norm(apex)
        heart = heart.turned(_axes(upwards, np.array([1.0, 0.0, 0.0]) - upwards[0] * upwards, 0.0))
    towards = _septum(septum, insertions, heart)
    heart = heart.turned(_axes(np.array([0.0, 0.0, 1.0]), towards, SEPTUM_DEG))
    wall_checks.check_one_ventricle(paths, heart)
    wall_checks.check_lines(paths, heart)
    return heart


# ---------------------------------------------------------------------------- files


def _read(path: Path) -> pyvista.PolyData:
    points, triangles = read_surface(path)
    if not np.isfinite(points).all():
        raise InputError(f"{path}: holds points that are no numbers (NaN); export it again")
    bare = pyvista.PolyData.from_regular_faces(points, triangles)
    surface = bare.clean(tolerance=1e-7)
    if surface.n_cells == 0:
        raise InputError(f"{path}: all its triangles have no area; export the surface again")
    surface = pyvista.PolyData(surface.points, faces=surface.faces)
    shared = _edges(surface, non_manifold_edges=True)
    if shared.n_cells:
        raise InputError(
            f"{path}: {shared.n_cells} edges belong to more than two triangles, the first at "
            f"{place_words(shared.points[0])}; export one clean surface, without walls inside"
        )
    return surface


def _edges(surface: pyvista.PolyData, **wanted: bool) -> pyvista.PolyData:
    kinds = ("boundary_edges", "non_manifold_edges", "feature_edges", "manifold_edges")
    return surface.extract_feature_edges(**{kind: wanted.get(kind, False) for kind in kinds})


def _loops(surface: pyvista.PolyData) -> list[np.ndarray]:
    """Points (n, 3) of every closed line that bounds the surface, the longest line first."""
    edges = _edges(surface, boundary_edges=True)
    if edges.n_cells == 0:
        return []
    pieces = edges.split_bodies()
    return [piece.points for piece in sorted(pieces, key=lambda piece: -piece.length)]


def _length(surface: pyvista.PolyData) -> float:
    """Extent along the surface's own longest direction."""
    points = surface.points.astype(float)
    size = np.abs(points).max() or 1.0  # squares of damaged coordinates overflow otherwise
    points = points / size
    points -= points.mean(axis=0)
    return size * np.ptp(points @ np.linalg.svd(points.T @ points)[0][:, 0])


def _check_lengths(
    paths: Mapping[str, Path], given: Mapping[str, pyvista.PolyData], unit: str
) -> None:
    low, high = PLAUSIBLE_LENGTH_MM
    lengths = {side: _length(surface) for side, surface in given.items()}
    unusual = [side for side, length in lengths.items() if not low <= length <= high]
    if not unusual:
        return
    side = unusual[0]
    fitting = [units_that_fit(length, unit) for length in lengths.values()]
    says = f"{paths[side]}: the ventricle is {lengths[side]:g} mm long"
    common = [u for u in fitting[0] if u in fitting[1]]
    if common:
        raise InputError(
            f"{says}; the surfaces look like some in {UNIT_NAMES[common[0]]}, set {KEY}.unit to "
            f"{common[0]}"
        )
    if all(fitting):
        first, second = (UNIT_NAMES[units[0]] for units in fitting)
        raise InputError(
            f"{says}; {paths['endocardium'].name} looks like {first} and "
            f"{paths['epicardium'].name} like {second}: save both in one unit"
        )
    raise InputError(f"{says}; between {low:g} and {high:g} are possible: check {KEY}.unit")


def _check_together(
    paths: Mapping[str, Path], given: Mapping[str, pyvista.PolyData], mm: float
) -> None:
    """Both surfaces in one frame: their boxes overlap."""
    low, high = (
        np.array([function(surface.points, axis=0) for surface in given.values()])
        for function in (np.min, np.max)
    )
    if (low.max(axis=0) > high.min(axis=0)).any():
        middles = [place_words((a + b) / 2 / mm) for a, b in zip(low, high, strict=True)]
        raise InputError(
            f"{paths['epicardium']}: lies around {middles[1]}, apart from {paths['endocardium']} "
            f"around {middles[0]}; save both in one frame of coordinates"
        )


# ---------------------------------------------------------------------------- base


def _base_plane(
    paths: Mapping[str, Path], given: Mapping[str, pyvista.PolyData], base: Mapping, mm: float
) -> tuple[np.ndarray, np.ndarray]:
    """(point, unit normal away from the apex) in mm: what the user says, or from the rims."""
    point, normal = (base.get(key) for key in ("point", "normal"))
    if (point is None) != (normal is None):
        raise InputError(f"{KEY}.base: give point and normal, or neither")
    if point is not None and normal is not None:
        size = np.linalg.norm(normal)
        if size == 0:
            raise InputError(f"{KEY}.base.normal: has no length; give the direction from the apex")
        return np.array(point, dtype=float) * mm, np.array(normal, dtype=float) / size
    rims = []
    for side, surface in given.items():
        loops = _loops(surface)
        if not loops:
            raise InputError(
                f"{paths[side]}: is a closed surface, which does not show its base; give the "
                f"base plane ({KEY}.base.point and {KEY}.base.normal)"
            )
        rims.append(loops[0])
    rim = np.concatenate(rims)
    point = np.mean([_centroid(loop) for loop in rims], axis=0)
    normal = np.linalg.svd((rim - point).T @ (rim - point))[0][:, 2]
    # Seen from the base, the whole ventricle lies on one side.
    side = np.mean([((surface.points - point) @ normal).mean() for surface in given.values()])
    return point, -np.sign(side) * normal


def _centroid(loop: np.ndarray) -> np.ndarray:
    """Middle of the closed line that passes through points (n, 3) on a plane, or nearly so.

    It is the centroid of the area; the points are put in order by their angle about their mean.
    """
    centre = loop.mean(axis=0)
    first, second = np.linalg.svd((loop - centre).T @ (loop - centre))[0][:, :2].T
    x, y = (loop - centre) @ first, (loop - centre) @ second
    order = np.argsort(np.arctan2(y, x), kind="stable")
    x, y = x[order], y[order]
    area = x * np.roll(y, -1) - np.roll(x, -1) * y
    moments = [((c + np.roll(c, -1)) * area).sum() / (3 * area.sum()) for c in (x, y)]
    return centre + moments[0] * first + moments[1] * second


def _axes(normal: np.ndarray, towards: np.ndarray, degrees: float) -> np.ndarray:
    """Rotation (3, 3), rows x, y and z, with z along `normal` and `towards`, which is perpendicular
    to it, at this angle, counter-clockwise seen from the end of z."""
    towards = towards / np.linalg.norm(towards)
    beside = np.cross(normal, towards)
    angle = np.radians(degrees)
    x = np.cos(angle) * towards - np.sin(angle) * beside
    return np.stack([x, np.cross(normal, x), normal])


def _cut_at_base(
    paths: Mapping[str, Path],
    given: Mapping[str, pyvista.PolyData],
    point: np.ndarray,
    rotation: np.ndarray,
    mm: float,
) -> tuple[list[pyvista.PolyData], np.ndarray]:
    """([endocardium, epicardium] below z = 0, origin): cut, with the axis in the rim's middle."""
    local, depth = [], 0.0
    for side, surface in given.items():
        moved = pyvista.PolyData((surface.points - point) @ rotation.T, faces=surface.faces)
        _check_crossing_of_base(paths[side], moved, rotation)
        depth = max(depth, _depth_of_rim(paths[side], side, moved, point, rotation, mm))
        local.append(moved)
    if depth > NOTABLE_MM:
        log.warning(
            "The rims are up to %.1f mm below the base plane; it is moved there, towards the apex",
            depth,
        )
    point = point - depth * rotation[2]
    cut = []
    for (side, path), surface in zip(paths.items(), local, strict=True):
        surface.points[:, 2] += depth
        cut.append(_below_base(path, side, surface, lambda x: (point + x @ rotation) / mm))
    middle = _centroid(_loops(cut[0])[0]) * [1, 1, 0]
    for surface in cut:
        surface.points -= middle
    return cut, point + middle @ rotation


def _check_crossing_of_base(path: Path, surface: pyvista.PolyData, rotation: np.ndarray) -> None:
    z = surface.points[:, 2]
    near = FLATNESS * np.ptp(z)
    if z.min() > -near or (z.max() < -near and not _loops(surface)):
        where = "above" if z.min() > -near else "below"
        raise InputError(
            f"{path}: lies {np.abs(z).min():.3g} to {np.abs(z).max():.3g} mm {where} the base "
            f"plane, which must cut it; correct {KEY}.base.point, or turn {KEY}.base.normal round: "
            "it points away from the apex"
        )
    sizes, above = areas(surface), middles(surface)[:, 2] > 0
    if sizes[above].sum() > LARGEST_SHARE_ABOVE * sizes.sum():
        turned = ", ".join(f"{-x:.4g}" for x in rotation[2])
        raise InputError(
            f"{path}: nearly all of it lies above the base plane, whose normal must point away "
            f"from the apex; write {KEY}.base.normal: [{turned}], or correct {KEY}.base.point"
        )


def _depth_of_rim(
    path: Path,
    side: str,
    surface: pyvista.PolyData,
    point: np.ndarray,
    rotation: np.ndarray,
    mm: float,
) -> float:
    """How far (mm) below z = 0 the surface's opening begins; other holes are an error."""
    near = FLATNESS * np.ptp(surface.points[:, 2])
    for k, loop in enumerate(_loops(surface)):
        lowest = loop[loop[:, 2].argmin()]
        depth = -lowest[2]
        if depth <= near:
            continue
        where = place_words((point + lowest @ rotation) / mm)
        if k > 0 or loop[:, 2].max() < -near < near < surface.points[:, 2].max():
            raise InputError(
                f"{path}: the {side} has a hole at {where}, {depth:.3g} mm below the base plane; "
                "close it: only the base may be open"
            )
        if depth > UNEVEN_MM:
            raise InputError(
                f"{path}: the {side} ends at {where}, {depth:.3g} mm below the base plane; cut "
                f"it flat, or give a base plane nearer the apex ({KEY}.base)"
            )
        return depth
    return 0.0


def _below_base(
    path: Path, side: str, surface: pyvista.PolyData, in_file: Callable[[np.ndarray], np.ndarray]
) -> pyvista.PolyData:
    """The part below z = 0: one piece with one opening, its triangles turned alike."""
    z = surface.points[:, 2]
    z[np.abs(z) < FLATNESS * np.ptp(z)] = 0.0
    # A lid in the base plane is no part of the surface.
    kept = surface.regular_faces[z[surface.regular_faces].min(axis=1) < 0]
    surface = pyvista.PolyData.from_regular_faces(surface.points, kept)
    if z.max() > 0:
        surface = surface.clip("z", origin=(0.0, 0.0, 0.0)).triangulate()
    surface = pyvista.PolyData(surface.points, faces=surface.faces).clean(tolerance=1e-7)
    pieces = surface.split_bodies()
    if len(pieces) > 1:
        areas = sorted((piece.area for piece in pieces), reverse=True)
        raise InputError(
            f"{path}: below the base the {side} falls into {len(pieces)} pieces, the largest with "
            f"{100 * areas[0] / sum(areas):.0f} % of the area; keep only the one that is the "
            f"{side}"
        )
    loops = _loops(surface)
    below = [loop for loop in loops if loop[:, 2].min() < -1e-6]
    if below:
        middle = place_words(in_file(below[0].mean(axis=0)))
        raise InputError(
            f"{path}: the {side} has a hole at {middle}, below the base plane; close it: only the "
            "base may be open"
        )
    if len(loops) != 1:
        raise InputError(
            f"{path}: the base plane cuts the {side} in {len(loops)} rings instead of one; give a "
            "surface with one layer, or move the base plane below the valves"
        )
    turned = surface.compute_normals(
        point_normals=False, consistent_normals=True, auto_orient_normals=False
    )
    return pyvista.PolyData(turned.points.astype(float), faces=turned.faces)


# ---------------------------------------------------------------------------- both together


def _check_inside(paths: Mapping[str, Path], heart: Ventricle) -> None:
    """The endocardium inside the epicardium, by their volumes and rims."""
    if heart.wall_volume_ml <= 0:
        cavity, outside = heart.cavity_volume_ml, enclosed_volume(heart.epicardium)
        raise InputError(
            f"{paths['endocardium']}: holds {cavity:.4g} mL and {paths['epicardium']} "
            f"{outside:.4g} mL; exchange {KEY}.endocardium and {KEY}.epicardium"
        )
    if not surrounds_axis(_loops(heart.epicardium)[0]):
        raise InputError(
            f"{paths['endocardium']}: lies beside {paths['epicardium']} and not inside it; save "
            "both in one frame of coordinates"
        )


def _apex(heart: Ventricle) -> np.ndarray:
    """Endocardial apex (3,) in the base's frame: the middle of what lies farthest from the base's
    middle. In a round ventricle that is much, so that one triangle does not turn the axis."""
    places, area = middles(heart.endocardium), areas(heart.endocardium)
    distance = np.where(
        places[:, 2] < DEEP * places[:, 2].min(), np.linalg.norm(places, axis=1), 0.0
    )
    far = distance > FAR * distance.max()
    return np.average(places[far], axis=0, weights=area[far])


def _check_tilt(heart: Ventricle, apex: np.ndarray) -> None:
    tilt = np.degrees(np.arctan2(np.hypot(apex[0], apex[1]), -apex[2]))
    says = (
        f"the apex, at {heart.in_file_words(apex)}, lies {tilt:.0f} degrees off the normal of "
        "the base"
    )
    if tilt > LARGEST_TILT_DEG:
        raise InputError(f"{KEY}.base: {says}; correct the normal, or cut across the long axis")
    if tilt > NOTABLE_TILT_DEG:
        log.warning("%s%s", says[0].upper(), says[1:])


def _septum(
    direction: Sequence[float] | None, insertions: Mapping | None, heart: Ventricle
) -> np.ndarray:
    """Horizontal vector (3,) towards the septum's middle in the ventricle's frame."""
    points = {name: point for name, point in (insertions or {}).items() if point is not None}
    if (direction is None) == (not points):
        raise InputError(
            f"{KEY}.septum: give the direction from the long axis to the septum's middle, or the "
            f"two points of {KEY}.insertions, and not both"
        )
    if direction is None:
        return _between_insertions(points, heart)
    towards = heart.rotation @ np.array(direction, dtype=float)
    across = np.hypot(towards[0], towards[1])
    if across < np.sin(np.radians(SMALLEST_SEPTUM_DEG)) * np.linalg.norm(towards) or across == 0:
        raise InputError(
            f"{KEY}.septum: {list(direction)} is parallel to the long axis, or nearly so; give the "
            "direction across it, from the cavity's middle towards the septum"
        )
    return towards * [1, 1, 0]


def _between_insertions(points: Mapping, heart: Ventricle) -> np.ndarray:
    if set(points) != {"anterior", "inferior"}:
        raise InputError(f"{KEY}.insertions: give both points, anterior and inferior")
    angle = {}
    for name, point in points.items():
        local = heart.rotation @ (np.array(point, dtype=float) * heart.mm_per_unit - heart.origin)
        distance = cKDTree(heart.epicardium.points).query(local)[0]
        if distance > INSERTION_MM:
            raise InputError(
                f"{KEY}.insertions.{name}: lies {distance:.3g} mm from the epicardium; give the "
                f"point where the right ventricle's wall meets it, in {KEY}.unit"
            )
        angle[name] = np.degrees(np.arctan2(local[1], local[0]))
    arc = (angle["anterior"] - angle["inferior"]) % 360
    if arc > 180 or arc < SMALLEST_SEPTUM_ARC_DEG:
        raise InputError(
            f"{KEY}.insertions: seen from the base, the septum would take {arc:.0f} degrees from "
            "the inferior to the anterior insertion, counter-clockwise; exchange the two, or, if "
            "they are right, the surfaces are mirrored: flip one axis back"
        )
    middle = np.radians(angle["inferior"] + arc / 2)
    return np.array([np.cos(middle), np.sin(middle), 0.0])
