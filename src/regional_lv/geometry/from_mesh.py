"""From an imported mesh to the study's mesh file, as it is or re-meshed, in one call each."""

import json
import logging
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.aha import SEGMENTS
from regional_lv.errors import InputError
from regional_lv.geometry.comparison import compare
from regional_lv.geometry.directions import nodal_directions, nodal_transmural_gradient
from regional_lv.geometry.fitted import FittedSurfaces, sector_table
from regional_lv.geometry.imported import import_mesh
from regional_lv.geometry.make import check_mesh_config
from regional_lv.geometry.mesh import read_mesh, write_mesh
from regional_lv.geometry.meshing import convert_mesh, write_gmsh
from regional_lv.geometry.summary import cell_volumes, segment_volumes, summarise_mesh

log = logging.getLogger(__name__)

# Distance (mm) between fitted and imported surface that a user should know of.
NOTABLE_MM = 0.5


def write_imported(mesh_path, segments_path, unit, fibres_cfg, vtu_path):
    """Check a mesh from elsewhere and write it with surfaces, coordinates and directions (.vtu)."""
    mesh = import_mesh(mesh_path, segments_path, unit)
    write_mesh(mesh, vtu_path, nodal_directions(mesh, fibres_cfg))


def keep_mesh(imported_vtu, fibres_cfg, vtu_path, segments_csv, summary_json):
    """Take the imported mesh as it is: linear hexahedra, segment table, summary."""
    mesh = read_mesh(imported_vtu)
    write_mesh(mesh, vtu_path, nodal_directions(mesh, fibres_cfg))
    _write(segment_table(mesh), segments_csv)
    _write_summary(summarise_mesh(mesh), summary_json)


def remesh(
    imported_vtu, mesh_cfg, fibres_cfg, msh_path, vtu_path, segments_csv, summary_json, fit_csv
):
    """Mesh the imported ventricle anew: quadratic hexahedra between fitted smooth surfaces.

    Mesh lines follow the borders of the imported segments (see `fitted`). Segment table and
    summary say how far each segment's volume is from the imported one; `fit_csv` holds the whole
    comparison.
    """
    check_mesh_config(mesh_cfg)
    imported = read_mesh(imported_vtu)
    surfaces = FittedSurfaces(imported)
    table = sector_table(imported, surfaces, mesh_cfg["circumferential"])
    write_gmsh(table, surfaces, mesh_cfg, msh_path)
    mesh = convert_mesh(msh_path)
    summary = summarise_mesh(mesh)
    if summary["scaled_jacobian_min"] <= 0:
        raise InputError(
            f"{imported_vtu}: re-meshed, the wall folds in segment {summary['worst_segment']}; "
            "raise mesh.circumferential or the rows of mesh, or set geometry.imported.remesh to "
            "false"
        )
    write_mesh(mesh, vtu_path, nodal_directions(mesh, fibres_cfg))
    fit = compare(imported, mesh)
    _write(fit, fit_csv)
    segments = segment_table(mesh)
    given = segment_volumes(imported)
    segments["volume_imported_ml"] = given
    segments["volume_deviation_percent"] = 100 * (segments["volume_ml"] / given - 1)
    _write(segments.merge(table, on="aha_segment"), segments_csv)
    worst = segments["volume_deviation_percent"].abs().idxmax()
    distance = fit[fit["quantity"].str.startswith("distance")]
    if distance["difference"].max() > NOTABLE_MM:
        log.warning(
            "The fitted surfaces are up to %.2f mm from the imported ones; a finer imported mesh "
            "or more elements (section mesh) bring them closer",
            distance["difference"].max(),
        )
    summary["imported"] = summarise_mesh(imported)
    summary["fit_mm"] = {
        f"{row.part}_{row.quantity.removeprefix('distance_')}": row.difference
        for row in distance.itertuples()
    }
    summary["segment_volume_deviation_percent"] = dict(
        zip(
            segments["aha_segment"].astype(str),
            segments["volume_deviation_percent"].round(2),
            strict=True,
        )
    )
    summary["largest_segment_volume_deviation"] = {
        "segment": int(segments["aha_segment"][worst]),
        "percent": float(segments["volume_deviation_percent"][worst]),
    }
    _write_summary(summary, summary_json)


def segment_table(mesh):
    """A row per AHA segment: volume_ml, thickness_mm (mean of 1/|grad t|), number of elements."""
    gradient = np.linalg.norm(nodal_transmural_gradient(mesh), axis=1)
    thickness = (1 / gradient)[mesh.cells].mean(axis=1)
    volume = cell_volumes(mesh)
    rows = []
    for segment in SEGMENTS:
        mine = mesh.segment == segment.number
        rows.append(
            {
                "aha_segment": segment.number,
                "name": segment.name,
                "zone": segment.zone,
                "volume_ml": volume[mine].sum(),
                "thickness_mm": np.average(thickness[mine], weights=volume[mine]),
                "elements": int(mine.sum()),
            }
        )
    return pd.DataFrame(rows)


def _write(table, path):
    table.to_csv(path, index=False, float_format="%.6g")


def _write_summary(summary, path):
    Path(path).write_text(json.dumps(summary, indent=2) + "\n")
