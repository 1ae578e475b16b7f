"""The heart that a configuration describes, whatever its geometry comes from."""

from collections.abc import Callable, Mapping
from pathlib import Path

from regional_lv.data.published import with_published_heart
from regional_lv.geometry.from_mesh import keep_mesh, remesh, write_imported
from regional_lv.geometry.from_surfaces import mesh_surfaces
from regional_lv.geometry.make import make_mesh
from regional_lv.geometry.meshing import write_gmsh
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.study.layout import HeartFiles


def make_heart(
    config: Mapping, files: HeartFiles, lay_out: Callable[..., None] = write_gmsh
) -> Path:
    """Mesh the heart of a checked configuration; the mesh's file (.vtu, opens in ParaView).

    files: what is written, and the folder that is made for it; the summary has the volumes of
    cavity and wall among others. lay_out: a function of `meshing`, for a segment table. The
    published heart is fetched if the study has no copy of it. Raises InputError for a geometry that
    cannot be meshed.
    """
    Path(files.mesh).parent.mkdir(parents=True, exist_ok=True)
    geometry, mesh, fibres = with_published_heart(config), config["mesh"], config["fibres"]
    zones = StiffnessInputs.from_config(config).zones
    made: dict = {"vtu": files.mesh, "segments": files.segments, "summary": files.summary}
    meshed = made | {"msh": files.gmsh, "zones": zones}
    if geometry["source"] == "segments":
        apices = geometry["endo_apex_z_mm"], geometry["epi_apex_z_mm"]
        make_mesh(geometry["segments"], *apices, mesh, fibres, **meshed, lay_out=lay_out)
        return Path(files.mesh)
    if geometry["source"] == "surfaces":
        given = geometry["surfaces"]
        mesh_surfaces(given["endocardium"], given["epicardium"], given, mesh, fibres, **meshed)
        return Path(files.mesh)
    given = geometry["imported"]
    write_imported(given["file"], given["unit"], fibres, files.imported, given["segments"], zones)
    if given["remesh"]:
        remesh(files.imported, mesh, fibres, **meshed, fit=files.fit)
    else:
        keep_mesh(files.imported, fibres, **made, zones=zones)
    return Path(files.mesh)
