"""Depth through the wall and height along it, on a mesh that comes without them."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from regional_lv.geometry.elements import gauss, jacobians, lagrange, nodes_of
from regional_lv.geometry.mesh import Mesh


def transmural_coordinate(
    mesh: Mesh, endocardium: np.ndarray, epicardium: np.ndarray
) -> np.ndarray:
    """Depth (n,), 0 on the endocardium's nodes and 1 on the epicardium's, as even as possible.

    Laplace's equation gives a first field s; its gradient is steeper where the wall's normals
    converge. The same equation with the conductivity |grad s| undoes that,

        div(|grad s| grad t) = 0,

    so that t has a constant slope along the normals where the two fields share them. Both are
    smooth up to the apex, and free on the base. `mesh` needs points and linear cells only.
    """
    gradients, measure = _gradients(mesh)
    s = _solve(mesh, gradients, measure, endocardium, epicardium)
    slope = np.linalg.norm(np.einsum("eqni,en->eqi", gradients, s[mesh.cells]), axis=-1)
    return _solve(mesh, gradients, measure * slope, endocardium, epicardium)


def _gradients(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions' gradients (cells, q, nodes, 3) and measures (cells, q)."""
    points, weights = gauss(3, 2)
    jacobian = jacobians(mesh, points)
    local = lagrange(points, nodes_of(mesh))[1]
    gradients = np.einsum("qnd,eqdx->eqnx", local, np.linalg.inv(jacobian))
    return gradients, np.linalg.det(jacobian) * weights


def _solve(
    mesh: Mesh, gradients: np.ndarray, weight: np.ndarray, zeros: np.ndarray, ones: np.ndarray
) -> np.ndarray:
    """Nodal values of div(k grad t) = 0, `weight` being k times the measure."""
    cells, n = mesh.cells, len(mesh.points)
    stiffness = np.einsum("eqni,eqmi,eq->enm", gradients, gradients, weight, optimize=True)
    k = cells.shape[1]
    rows, columns = np.repeat(cells, k, axis=1).ravel(), np.tile(cells, k).ravel()
    matrix = sparse.csc_matrix((stiffness.ravel(), (rows, columns)), shape=(n, n))
    t = np.zeros(n)
    t[ones] = 1.0
    free = np.setdiff1d(np.arange(n), np.concatenate([zeros, ones]))
    inner = matrix[free][:, free]
    factor = splu(inner.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    t[free] = factor.solve(-(matrix[free] @ t))
    return t


def longitudinal_coordinate(
    points: np.ndarray, transmural: np.ndarray, endo_apex_z_mm: float, epi_apex_z_mm: float
) -> np.ndarray:
    """Height (n,), 0 at the apex to 1 at the base plane z = 0, like the bullseye's radius.

    It is 1 - 2 u / pi, with the latitude u of an ellipsoid whose apex lies between the two.
    """
    apex = (1 - transmural) * endo_apex_z_mm + transmural * epi_apex_z_mm
    return 1 - np.arcsin(np.clip(points[:, 2] / apex, 0, 1)) * 2 / np.pi
