"""Surfaces of triangles (pyvista.PolyData, mm): places on them, and what they enclose."""

import numpy as np
import pyvista


def enclosed_volume(surface: pyvista.PolyData) -> float:
    """Volume (mL) between a surface that is open in a plane through the origin, and that plane."""
    return float(abs(cones(surface).sum()) / 6e3)


def cones(surface: pyvista.PolyData) -> np.ndarray:
    """Six times the signed volumes (n,) of the tetrahedra from the origin to the triangles."""
    a, b, c = np.swapaxes(surface.points[surface.regular_faces], 0, 1)
    return np.einsum("nx,nx->n", a, np.cross(b, c))


def areas(surface: pyvista.PolyData) -> np.ndarray:
    """Area (n,) of the triangles in mm2."""
    return surface.compute_cell_sizes(length=False, volume=False)["Area"]


def middles(surface: pyvista.PolyData) -> np.ndarray:
    """Middles (n, 3) of the triangles."""
    return surface.points[surface.regular_faces].mean(axis=1)


def triangle_points(surface: pyvista.PolyData, spacing_mm: float) -> np.ndarray:
    """Points (n, 3) on the triangles' corners, edges and faces, at most so far apart."""
    corners = surface.points[surface.regular_faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    steps = np.ceil(edges / spacing_mm).astype(int)
    found = []
    for n in np.unique(steps):
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        inside = i + j <= n
        shares = np.stack([i[inside], j[inside], n - i[inside] - j[inside]], axis=1) / n
        found.append(np.einsum("qc,tcx->tqx", shares, corners[steps == n]).reshape(-1, 3))
    return np.concatenate(found)
