"""The heart that a configuration describes, whatever its geometry comes from."""

from collections.abc import Callable, Mapping
from pathlib import Path

from regional_lv.data.published import HEART_MESH, HEART_SEGMENTS, PUBLISHED_HEART, fetched_path
from regional_lv.geometry.from_mesh import keep_mesh, remesh, write_imported
from regional_lv.geometry.from_surfaces import mesh_surfaces
from regional_lv.geometry.make import make_mesh
from regional_lv.geometry.meshing import write_gmsh
from regional_lv.inputs.stiffness import StiffnessInputs


def make_heart(
    config: Mapping, folder: str | Path, lay_out: Callable[..., None] = write_gmsh
) -> Path:
    """Mesh the heart of a checked configuration; the mesh's file (.vtu, opens in ParaView).

    `mesh.vtu`, `segments.csv` and `summary.json` (cavity and wall volume among others) go to
    `folder`, with what they are made from. lay_out: a function of `meshing`, for a segment table.
    Raises InputError for a geometry that cannot be meshed.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    geometry, mesh, fibres = config["geometry"], config["mesh"], config["fibres"]
    zones = StiffnessInputs.from_config(config).zones
    made = {
        "vtu": folder / "mesh.vtu",
        "segments": folder / "segments.csv",
        "summary": folder / "summary.json",
    }
    meshed = made | {"msh": folder / "mesh.msh", "zones": zones}
    if geometry["source"] == "segments":
        apices = geometry["endo_apex_z_mm"], geometry["epi_apex_z_mm"]
        make_mesh(geometry["segments"], *apices, mesh, fibres, **meshed, lay_out=lay_out)
        return made["vtu"]
    if geometry["source"] == "surfaces":
        given = geometry["surfaces"]
        mesh_surfaces(given["endocardium"], given["epicardium"], given, mesh, fibres, **meshed)
        return made["vtu"]
    given = geometry["imported"]
    files = given["file"], given["segments"]
    if given["file"] == PUBLISHED_HEART:
        study = config["study"]
        files = fetched_path(study, HEART_MESH), fetched_path(study, HEART_SEGMENTS)
    imported = folder / "imported.vtu"
    write_imported(files[0], given["unit"], fibres, imported, files[1], zones)
    if given["remesh"]:
        made |= {"msh": folder / "mesh.msh", "fit": folder / "fit.csv"}
        remesh(imported, mesh, fibres, **made, zones=zones)
    else:
        keep_mesh(imported, fibres, **made, zones=zones)
    return made["vtu"]
