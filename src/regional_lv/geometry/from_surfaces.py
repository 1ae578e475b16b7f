"""From two triangulated surfaces to the study's mesh file, in one call."""

import logging

import numpy as np
from scipy.spatial import cKDTree

from regional_lv.errors import InputError
from regional_lv.geometry.comparison import normal_distances, sample_surface
from regional_lv.geometry.fitted import FittedSurfaces, StarSurface, aha_sectors
from regional_lv.geometry.from_mesh import segment_table, write_summary, write_table
from regional_lv.geometry.make import mesh_between
from regional_lv.geometry.mesh import ENDOCARDIUM, EPICARDIUM, SURFACES
from regional_lv.geometry.mesh_config import check_mesh_config
from regional_lv.geometry.summary import cavity_volume, segment_volumes, summarise_mesh
from regional_lv.geometry.triangulated import SIDES, read_ventricle, triangle_points

log = logging.getLogger(__name__)

LEVEL_ENDS = (1 / 3, 2 / 3, 0.9)
"""Where basal, mid and apical level end, as shares of the cavity's length on the long axis.

The AHA divides the ventricle into thirds perpendicular to the long axis; segment 17 is the tip
beyond the cavity's end (Cerqueira et al. 2002, doi 10.1161/hc0402.102975). Here that segment begins
with the last tenth of the cavity, so that it has an endocardium, whose strains are defined."""

# Points (mm) of the surfaces that are fitted: at most so far apart on a triangle, and one per cube
# of this edge. The polynomials' shortest wave at the base is some 7 mm long.
GAP_MM, THINNED_MM = 3.0, 1.5
# Distance (mm) between the places at which the given surface is compared with the mesh's.
SAMPLED_MM = 1.0
# Distances (mm) between given and fitted surface: to be told, and not to be accepted.
NOTABLE_MM, LARGEST_MM = 1.0, 5.0


def mesh_surfaces(
    endocardium,
    epicardium,
    surfaces,
    mesh,
    fibres,
    msh,
    vtu,
    segments,
    summary,
    zones=None,
):
    """Mesh a left ventricle through its endocardium and epicardium (STL, PLY, OBJ, VTP, VTK).

    Parameters
    ----------
    endocardium, epicardium: paths of the two surfaces.
    surfaces: unit, base, septum and insertions, as `triangulated.read_ventricle` takes them; other
        keys are not used.
    mesh, fibres, zones: as in `make.make_mesh`.
    msh, vtu, segments, summary: files that are written, as in `make.make_mesh`. The summary has
        beside the mesh's figures those of the given surfaces, how far from them the mesh's are
        (`fit_mm`: largest and root mean square, normal to the surface), the thickness of the
        segments' walls, and the `frame`: a point x of the files, in mm, becomes
        `rotation @ (x - origin_mm)`.

    Raises
    ------
    InputError: for surfaces that cannot be used or fitted, with the place and the remedy.
    """
    check_mesh_config(mesh)
    paths = dict(zip(SIDES, (endocardium, epicardium), strict=True))
    wanted = ("unit", "base", "septum", "insertions")
    heart = read_ventricle(*paths.values(), **{key: surfaces[key] for key in wanted})
    given = {side: getattr(heart, side) for side in SIDES}
    stars = {side: _fit(paths[side], given[side], heart) for side in SIDES}
    length = -stars["endocardium"].apex
    fitted = FittedSurfaces.of_planes(*stars.values(), [-share * length for share in LEVEL_ENDS])
    sectors = aha_sectors(fitted)
    made = mesh_between(
        sectors,
        fitted,
        mesh,
        fibres,
        msh,
        vtu,
        zones,
        origin=f"{paths['endocardium']}, {paths['epicardium']}",
        remedy="smooth the surfaces there, or raise mesh.circumferential or the rows of mesh",
    )
    table = segment_table(made)
    write_table(table.merge(sectors, on="aha_segment"), segments)
    thickness = table["thickness_mm"]
    volumes = {
        "cavity": (cavity_volume(made), heart.cavity_volume_ml),
        "wall": (float(segment_volumes(made).sum()), heart.wall_volume_ml),
    }
    write_summary(
        summarise_mesh(made)
        | {
            "long_axis_mm": length,
            "segment_thickness_mm": {
                "least": float(thickness.min()),
                "mean": float(np.average(thickness, weights=table["volume_ml"])),
                "largest": float(thickness.max()),
            },
            "given": {f"{part}_volume_ml": volume for part, (_, volume) in volumes.items()},
            "volume_deviation_percent": {
                part: 100 * (now / volume - 1) for part, (now, volume) in volumes.items()
            },
            "fit_mm": _closeness(paths, given, made, heart),
            "frame": {"origin_mm": heart.origin.tolist(), "rotation": heart.rotation.tolist()},
        },
        summary,
    )


def _fit(path, surface, heart):
    """`StarSurface` through a triangulated surface."""
    star = StarSurface(_points_to_fit(surface))
    phi, u, _ = star.coordinates(surface.points)
    there = star(phi, u)
    # Along the ray from the base's middle, which is no less than the distance to the surface.
    distance = cKDTree(there).query(surface.points)[0]
    worst = distance.argmax()
    if distance[worst] > LARGEST_MM:
        raise InputError(
            f"{path}: a smooth surface through it stays {distance[worst]:.1f} mm away at "
            f"{heart.in_file_words(surface.points[worst])}; smooth the surface there and leave "
            "papillary muscles to the cavity"
        )
    return star


def _points_to_fit(surface):
    """Corners of the triangles, in large ones points between them, in dense places fewer."""
    points = np.concatenate([surface.points, triangle_points(surface, GAP_MM)])
    # Of each cell of a fine grid one point; those in the base plane have cells of their own.
    cell = np.column_stack([np.floor(points / THINNED_MM), points[:, 2] > -1e-6])
    _, first = np.unique(cell, axis=0, return_index=True)
    return points[np.sort(first)]


def _closeness(paths, given, made, heart):
    """Largest and root mean square distance (mm) of each surface from the mesh's."""
    found = {}
    for number in (ENDOCARDIUM, EPICARDIUM):
        side = SURFACES[number]
        dense = triangle_points(given[side], SAMPLED_MM)
        distance = normal_distances(dense, *sample_surface(made, number))
        worst = distance.argmax()
        if distance[worst] > NOTABLE_MM:
            log.warning(
                "The mesh is up to %.1f mm from %s, farthest at %s; a smoother surface or more "
                "elements (section mesh) bring it closer",
                distance[worst],
                paths[side],
                heart.in_file_words(dense[worst]),
            )
        found[f"{side}_max"] = float(distance[worst])
        found[f"{side}_rms"] = float(np.sqrt((distance**2).mean()))
    return found
