"""From an imported mesh to the study's mesh file, as it is or re-meshed, in one call each."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.aha import SEGMENTS
from regional_lv.errors import InputError
from regional_lv.geometry.comparison import compare
from regional_lv.geometry.directions import nodal_directions, nodal_transmural_gradient
from regional_lv.geometry.fitted import LARGEST_MM, FittedSurfaces, sector_table
from regional_lv.geometry.imported import import_mesh
from regional_lv.geometry.make import mesh_between
from regional_lv.geometry.mesh import (
    ENDOCARDIUM,
    EPICARDIUM,
    SURFACES,
    Mesh,
    read_mesh,
    write_mesh,
)
from regional_lv.geometry.mesh_config import check_mesh_config
from regional_lv.geometry.summary import (
    cell_volumes,
    segment_volumes,
    summarise_mesh,
    write_summary,
    write_table,
)

log = logging.getLogger(__name__)

# Distance (mm) between fitted and imported surface that a user should know of.
NOTABLE_MM = 0.5


def write_imported(
    mesh: str | Path,
    unit: str,
    fibres: Mapping[str, float],
    vtu: str | Path,
    segments: str | Path | None = None,
    zones: Mapping[str, Sequence[int]] | None = None,
) -> None:
    """Check a mesh from elsewhere and write it with surfaces, coordinates and directions (.vtu).

    `mesh` and `segments` are what `import_mesh` reads; `zones` as in `write_mesh`.
    """
    imported = import_mesh(mesh, segments, unit)
    write_mesh(imported, vtu, nodal_directions(imported, fibres), zones=zones)


def keep_mesh(
    imported: str | Path,
    fibres: Mapping[str, float],
    vtu: str | Path,
    segments: str | Path,
    summary: str | Path,
    zones: Mapping[str, Sequence[int]] | None = None,
) -> None:
    """Take the imported mesh (.vtu) as it is: linear hexahedra, segment table, summary."""
    mesh = read_mesh(imported)
    write_mesh(mesh, vtu, nodal_directions(mesh, fibres), zones=zones)
    write_table(measured_segments(mesh), segments)
    write_summary(summarise_mesh(mesh), summary)


def remesh(
    imported: str | Path,
    mesh: Mapping,
    fibres: Mapping[str, float],
    msh: str | Path,
    vtu: str | Path,
    segments: str | Path,
    summary: str | Path,
    fit: str | Path,
    zones: Mapping[str, Sequence[int]] | None = None,
) -> None:
    """Mesh the imported ventricle (.vtu) anew: quadratic hexahedra between fitted smooth surfaces.

    Mesh lines follow the borders of the imported segments (see `fitted`). Segment table and
    summary say how far each segment's volume is from the imported one; `fit` (CSV) holds the whole
    comparison. Raises InputError for a ventricle to which no smooth surface comes close, such as
    one whose apex is far from the z axis.
    """
    check_mesh_config(mesh)
    given = read_mesh(imported)
    surfaces = FittedSurfaces.of_mesh(given)
    _check_fit(imported, given, surfaces)
    sectors = sector_table(given, surfaces, mesh["circumferential"])
    made = mesh_between(
        sectors,
        surfaces,
        mesh,
        fibres,
        msh,
        vtu,
        zones,
        origin=imported,
        remedy="raise mesh.circumferential or the rows of mesh, or set geometry.imported.remesh "
        "to false",
    )
    numbers = summarise_mesh(made)
    comparison = compare(given, made)
    write_table(comparison, fit)
    by_segment = measured_segments(made)
    volumes = segment_volumes(given)
    by_segment["volume_imported_ml"] = volumes
    by_segment["volume_deviation_percent"] = 100 * (by_segment["volume_ml"] / volumes - 1)
    write_table(by_segment.merge(sectors, on="aha_segment"), segments)
    worst = by_segment["volume_deviation_percent"].abs().idxmax()
    distance = comparison[comparison["quantity"].str.startswith("distance")]
    if distance["difference"].max() > NOTABLE_MM:
        log.warning(
            "The fitted surfaces are up to %.2f mm from the imported ones; a finer imported mesh, "
            "more elements (section mesh) or an apex nearer the z axis, which it is %.0f degrees "
            "off, bring them closer",
            distance["difference"].max(),
            _tilt_deg(given),
        )
    numbers["imported"] = summarise_mesh(given)
    numbers["fit_mm"] = {
        f"{row.part}_{row.quantity.removeprefix('distance_')}": row.difference
        for row in distance.itertuples()
    }
    numbers["segment_volume_deviation_percent"] = dict(
        zip(
            by_segment["aha_segment"].astype(str),
            by_segment["volume_deviation_percent"].round(2),
            strict=True,
        )
    )
    numbers["largest_segment_volume_deviation"] = {
        "segment": int(by_segment["aha_segment"][worst]),
        "percent": float(by_segment["volume_deviation_percent"][worst]),
    }
    write_summary(numbers, summary)


def _check_fit(origin: str | Path, given: Mesh, surfaces: FittedSurfaces) -> None:
    """The smooth surfaces lie near the imported ones."""
    for number, smooth in zip((ENDOCARDIUM, EPICARDIUM), surfaces.sides, strict=True):
        worst = smooth.misfit(given.points[given.nodes_on(number)]).max()
        if worst > LARGEST_MM:
            raise InputError(
                f"{origin}: a smooth surface through its {SURFACES[number]} stays {worst:.1f} mm "
                f"away from it, and its apex lies {_tilt_deg(given):.0f} degrees off the z axis, "
                "the normal of its base; cut its base across the long axis, keep its elements "
                "(geometry.imported.remesh: false), or give its endocardium and epicardium as "
                "surfaces, whose base may be oblique (geometry.source: surfaces)"
            )


def _tilt_deg(mesh: Mesh) -> float:
    """How far the endocardial apex is from the z axis, seen from the origin in the base."""
    inner = mesh.points[mesh.nodes_on(ENDOCARDIUM)]
    x, y, z = inner[inner[:, 2].argmin()]
    return float(np.degrees(np.arctan2(np.hypot(x, y), -z)))


def measured_segments(mesh: Mesh) -> pd.DataFrame:
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
                "volume_ml": volume[mine].sum(),
                "thickness_mm": np.average(thickness[mine], weights=volume[mine]),
                "elements": int(mine.sum()),
            }
        )
    return pd.DataFrame(rows)
