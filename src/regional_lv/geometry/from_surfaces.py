"""From two triangulated surfaces to the study's mesh file, in one call."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyvista

from regional_lv.errors import InputError
from regional_lv.geometry.comparison import normal_distances, sample_surface
from regional_lv.geometry.fitted import LARGEST_MM, FittedSurfaces, aha_sectors
from regional_lv.geometry.from_mesh import measured_segments
from regional_lv.geometry.make import mesh_between
from regional_lv.geometry.mesh import ENDOCARDIUM, EPICARDIUM, SURFACES, Mesh
from regional_lv.geometry.mesh_config import check_mesh_config
from regional_lv.geometry.summary import (
    cavity_volume,
    segment_volumes,
    summarise_mesh,
    write_summary,
    write_table,
)
from regional_lv.geometry.surfaces import QUARTER
from regional_lv.geometry.triangles import triangle_points
from regional_lv.geometry.triangulated import read_configured
from regional_lv.geometry.ventricle import SIDES, Ventricle
from regional_lv.geometry.wall_checks import where
from regional_lv.geometry.wall_lines import LEVEL_ENDS

log = logging.getLogger(__name__)

# Distance (mm) between the places at which the given surface is compared with the mesh's.
SAMPLED_MM = 1.0
# Distance (mm) between given and fitted surface that a user should know of.
NOTABLE_MM = 1.0


def mesh_surfaces(
    endocardium: str | Path,
    epicardium: str | Path,
    surfaces: Mapping,
    mesh: Mapping,
    fibres: Mapping[str, float],
    msh: str | Path,
    vtu: str | Path,
    segments: str | Path,
    summary: str | Path,
    zones: Mapping[str, Sequence[int]] | None = None,
) -> None:
    """Mesh a left ventricle through its endocardium and epicardium (STL, PLY, OBJ, VTP, VTK).

    Parameters
    ----------
    endocardium, epicardium: paths of the two surfaces.
    surfaces: unit, base, septum, insertions and long_axis, as `triangulated.read_ventricle` takes
        them; other keys are not used.
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
    heart = read_configured(endocardium, epicardium, surfaces)
    given = {side: getattr(heart, side) for side in SIDES}
    _check_fit(paths, given, heart)
    inner, outer = heart.smooth.values()
    fitted = FittedSurfaces.of_lines(inner, outer, LEVEL_ENDS)
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
    table = measured_segments(made)
    write_table(table.merge(sectors, on="aha_segment"), segments)
    thickness = table["thickness_mm"]
    volumes = {
        "cavity": (cavity_volume(made), heart.cavity_volume_ml),
        "wall": (float(segment_volumes(made).sum()), heart.wall_volume_ml),
    }
    write_summary(
        summarise_mesh(made)
        | {
            "long_axis_mm": float(-inner(np.zeros(1), np.full(1, QUARTER))[0, 2]),
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


def _check_fit(
    paths: Mapping[str, str | Path], given: Mapping[str, pyvista.PolyData], heart: Ventricle
) -> None:
    """The smooth surfaces lie near the given ones."""
    for side, smooth in heart.smooth.items():
        points = given[side].points
        distance = smooth.misfit(points)
        worst = distance.argmax()
        if distance[worst] > LARGEST_MM:
            raise InputError(
                f"{paths[side]}: a smooth surface through it stays {distance[worst]:.1f} mm away "
                f"at {where(heart, points[worst])}; smooth the surface there and leave papillary "
                "muscles to the cavity"
            )


def _closeness(
    paths: Mapping[str, str | Path],
    given: Mapping[str, pyvista.PolyData],
    made: Mesh,
    heart: Ventricle,
) -> dict[str, float]:
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
