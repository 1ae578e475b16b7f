"""From the segment table to the mesh file, in one call."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from regional_lv.errors import InputError
from regional_lv.geometry.directions import nodal_directions
from regional_lv.geometry.mesh import Mesh, write_mesh
from regional_lv.geometry.mesh_config import check_mesh_config
from regional_lv.geometry.meshing import convert_mesh, write_gmsh
from regional_lv.geometry.summary import scaled_jacobians, summarise, write_summary, write_table
from regional_lv.geometry.surfaces import Surfaces, Wall
from regional_lv.geometry.table import check_apices, read_segments


def mesh_between(
    table: pd.DataFrame,
    surfaces: Wall,
    mesh: Mapping,
    fibres: Mapping[str, float],
    msh: str | Path,
    vtu: str | Path,
    zones: Mapping[str, Sequence[int]] | None,
    origin: str | Path,
    remedy: str,
    lay_out: Callable[..., None] = write_gmsh,
) -> Mesh:
    """Mesh between two surfaces, with the borders of a segment table, as .msh and as .vtu.

    `surfaces` is what `meshing.write_gmsh` takes, `mesh`, `fibres` and `zones` are as in
    `make_mesh`; `lay_out` is that function, or `meshing.write_plain`. Raises InputError for a wall
    that folds, with its `origin` (a file) and the `remedy`.
    """
    lay_out(table, surfaces, mesh, msh)
    made = convert_mesh(msh)
    quality = scaled_jacobians(made).min(axis=1)
    if quality.min() <= 0:
        segment = made.segment[quality.argmin()]
        raise InputError(f"{origin}: the wall folds in segment {segment}; {remedy}")
    write_mesh(made, vtu, nodal_directions(made, fibres), zones=zones)
    return made


def make_mesh(
    table: str | Path,
    endo_apex_z_mm: float,
    epi_apex_z_mm: float,
    mesh: Mapping,
    fibres: Mapping[str, float],
    msh: str | Path,
    vtu: str | Path,
    segments: str | Path,
    summary: str | Path,
    zones: Mapping[str, Sequence[int]] | None = None,
    lay_out: Callable[..., None] = write_gmsh,
) -> None:
    """Make the parametric left ventricle from a segment table (CSV).

    `table` is its path, or the word `volunteer`; `mesh` holds circumferential (16, 24, 32, 40 or 48
    elements), basal, mid, apical, apex (rows of elements per level) and transmural (layers);
    `fibres` the angles of `fibre_directions`; `zones`, if given, AHA segments by name. Files that
    are written: `msh` for gmsh, `vtu` for ParaView, `segments` (CSV: what each segment became) and
    `summary` (JSON). The .vtu carries `segment`, `zone`, `surface` per cell and per point
    `transmural`, `longitudinal` (0 apex to 1 base) and the direction fields. Same input, same
    bytes. `lay_out` is as in `mesh_between`. Raises InputError for a table that cannot be used, or
    whose surfaces cross.
    """
    given = read_segments(table)
    check_apices(table, given, endo_apex_z_mm, epi_apex_z_mm)
    check_mesh_config(mesh)
    surfaces = Surfaces(given, endo_apex_z_mm, epi_apex_z_mm)
    made = mesh_between(
        given,
        surfaces,
        mesh,
        fibres,
        msh,
        vtu,
        zones,
        origin=table,
        remedy="its thickness or radius differs too much from its neighbours', or two sector "
        "borders nearly coincide; check the row, or raise mesh.circumferential",
        lay_out=lay_out,
    )
    by_segment, numbers = summarise(made, given)
    write_table(by_segment, segments)
    write_summary(numbers, summary)
