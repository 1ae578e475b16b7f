"""Local directions and fibres, in the form that the simulator mirrors, and at the nodes."""

from collections.abc import Mapping

import numpy as np

from regional_lv.geometry.elements import jacobians, lagrange, nodes_of
from regional_lv.geometry.mesh import Mesh

KINDS = ("helix", "sheet")


def fibre_angles(fibres: Mapping[str, float]) -> dict[str, float]:
    """Angles (rad) at both surfaces, `helix_endo` to `sheet_epi`, of the section `fibres`.

    `rotation_deg`, if there is one, is added to the helix angle at the endocardium and taken from
    that at the epicardium.
    """
    names = [f"{kind}_{side}" for kind in KINDS for side in ("endo", "epi")]
    rotation = fibres.get("rotation_deg", 0.0)
    turned = {"helix_endo": rotation, "helix_epi": -rotation}
    return {name: np.deg2rad(fibres[f"{name}_deg"] + turned.get(name, 0.0)) for name in names}


def local_directions(
    gradient_of_transmural: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit circumferential, radial and longitudinal directions (c, r, l) from grad t.

        r = grad t / |grad t|,     c = (e_z x r) / |e_z x r|,     l = r x c

    `gradient_of_transmural` has shape (..., 3); so have the results. r points from endocardium to
    epicardium, c counter-clockwise seen from the base, l towards the base; (r, c, l) is
    right-handed. c and l do not exist where r is parallel to the long axis: at the pole only.
    """
    radial = gradient_of_transmural / np.linalg.norm(gradient_of_transmural, axis=-1)[..., None]
    circumferential = np.stack(
        [-radial[..., 1], radial[..., 0], np.zeros_like(radial[..., 0])], axis=-1
    )
    circumferential /= np.linalg.norm(circumferential, axis=-1)[..., None]
    return circumferential, radial, np.cross(radial, circumferential)


def fibre_directions(
    t: np.ndarray,
    circumferential: np.ndarray,
    radial: np.ndarray,
    longitudinal: np.ndarray,
    fibres: Mapping[str, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Unit fibre and sheet directions at transmural depth t (rule-based).

        h = (1 - t) helix_endo + t helix_epi          f = cos(h) c + sin(h) l
        n = -sin(h) c + cos(h) l                      (normal to the fibre, tangent to the wall)
        b = (1 - t) sheet_endo + t sheet_epi          s = cos(b) r + sin(b) n

    t has shape (...), the directions (..., 3); `fibres` is as in `fibre_angles`. A positive helix
    angle turns the fibre from the circumferential direction (counter-clockwise seen from the base)
    towards the base: a right-handed helix, the endocardium's in the common convention (Streeter et
    al. 1969, doi 10.1161/01.RES.24.3.339).
    """
    ends = fibre_angles(fibres)
    helix, sheet = (
        ((1 - t) * ends[f"{kind}_endo"] + t * ends[f"{kind}_epi"])[..., None] for kind in KINDS
    )
    fibre = np.cos(helix) * circumferential + np.sin(helix) * longitudinal
    normal = -np.sin(helix) * circumferential + np.cos(helix) * longitudinal
    return fibre, np.cos(sheet) * radial + np.sin(sheet) * normal


def nodal_transmural_gradient(mesh: Mesh) -> np.ndarray:
    """grad t (n, 3) at the nodes, averaged over the elements that share a node."""
    nodes = nodes_of(mesh)
    jacobian = jacobians(mesh, nodes)
    local = np.einsum("en,qnd->eqd", mesh.transmural[mesh.cells], lagrange(nodes, nodes)[1])
    gradient = np.linalg.solve(np.swapaxes(jacobian, -1, -2), local[..., None])[..., 0]
    total = np.zeros_like(mesh.points)
    np.add.at(total, mesh.cells, gradient)
    return total / np.bincount(mesh.cells.ravel(), minlength=len(total))[:, None]


def nodal_directions(mesh: Mesh, fibres: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Direction fields (n, 3) at the nodes, for viewing; at the pole c is set to +x."""
    gradient = nodal_transmural_gradient(mesh)
    on_axis = np.hypot(mesh.points[:, 0], mesh.points[:, 1]) < 1e-6
    gradient[on_axis] = [0.0, -1e-9, -1.0]
    c, r, longitudinal = local_directions(gradient)
    fibre, sheet = fibre_directions(mesh.transmural, c, r, longitudinal, fibres)
    return {
        "fibre": fibre,
        "sheet": sheet,
        "circumferential": c,
        "radial": r,
        "longitudinal_direction": longitudinal,
    }
