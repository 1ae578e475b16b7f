"""The config section `mesh`: what can be meshed, and what is finer. Imports no mesher: the workflow
reads it."""

from collections.abc import Mapping

from regional_lv.errors import InputError

ROWS = ("basal", "mid", "apical", "apex", "transmural")


def check_mesh_config(mesh: Mapping) -> None:
    """Raise InputError for a config section `mesh` that cannot be meshed."""
    n = mesh["circumferential"]
    if n < 16 or n % 8:
        raise InputError(
            f"mesh.circumferential is {n}; use a multiple of 8 from 16 on (the apex patch has a "
            "quarter of it along each side, and a node at the pole)"
        )
    for key in ROWS:
        if mesh[key] < 1:
            raise InputError(f"mesh.{key} is {mesh[key]}; use at least 1")


def finer(mesh: dict) -> dict:
    """A config section `mesh` with one row more in every direction, and eight elements more around
    the ventricle: what is simulated on it does not share the study's errors of discretisation."""
    rows = {key: mesh[key] + 1 for key in ROWS}
    return {**mesh, **rows, "circumferential": mesh["circumferential"] + 8}
