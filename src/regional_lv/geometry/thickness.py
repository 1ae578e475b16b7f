"""A wall made thicker or thinner as a whole: the endocardium stays, the epicardium moves."""

from dataclasses import replace

import numpy as np

from regional_lv.errors import InputError
from regional_lv.geometry.elements import FACES, nodes_of
from regional_lv.geometry.mesh import ENDOCARDIUM, Mesh


def thickened(mesh: Mesh, scale: float) -> Mesh:
    """`mesh` with all distances from the endocardium, along the lines of nodes, times `scale`.

    Cavity, transmural coordinate, tags and numbering stay. Raises InputError for a mesh without
    columns of cells from the endocardium through the wall.
    """
    if scale == 1:
        return mesh
    foot = mesh.points[endocardial_foot(mesh, "geometry.wall_thickness_scale")]
    return replace(mesh, points=foot + scale * (mesh.points - foot))


def endocardial_foot(mesh: Mesh, needed_by: str) -> np.ndarray:
    """Node (n,) of the endocardium from which the line of each node through the wall starts.

    Raises InputError for a mesh without columns of cells; needed_by: the key that needs them.
    """
    reference = nodes_of(mesh)
    cell_of: dict[tuple, list] = {}
    for cell, faces in enumerate(np.sort(mesh.cells[:, FACES], axis=2)):
        for face, corners in enumerate(faces):
            cell_of.setdefault(tuple(corners), []).append((cell, face))
    foot = np.full(len(mesh.points), -1)
    inner = mesh.facets[mesh.surface == ENDOCARDIUM]
    foot[inner] = inner
    waiting = [tuple(sorted(corners)) for corners in inner[:, :4]]
    passed = np.zeros(len(mesh.cells), dtype=bool)
    while waiting:
        for cell, face in cell_of[waiting.pop()]:
            if passed[cell]:
                continue
            passed[cell] = True
            nodes, axis = mesh.cells[cell], face // 2
            across = np.delete(reference, axis, axis=1)
            start = np.flatnonzero(reference[:, axis] == reference[FACES[face][0], axis])
            same = (across[:, None] == across[start]).all(axis=2)
            foot[nodes] = foot[nodes[start]][same.argmax(axis=1)]
            # Faces come in pairs of opposites: 0 and 1, 2 and 3, 4 and 5.
            waiting.append(tuple(sorted(nodes[FACES[face ^ 1]])))
    if (foot < 0).any():
        raise InputError(
            f"{needed_by}: the mesh has no columns of cells from the endocardium to the "
            "epicardium, along which a wall changes its shape; leave it out, or mesh anew "
            "(geometry.imported.remesh: true)"
        )
    return foot
