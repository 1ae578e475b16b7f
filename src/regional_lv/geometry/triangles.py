"""Surfaces of triangles (pyvista.PolyData, mm): places on them, and what they enclose."""

import numpy as np


def enclosed_volume(surface):
    """Volume (mL) between a surface that is open in a plane through the origin, and that plane."""
    return float(abs(cones(surface).sum()) / 6e3)


def cones(surface):
    """Six times the signed volumes (n,) of the tetrahedra from the origin to the triangles."""
    a, b, c = np.swapaxes(surface.points[surface.regular_faces], 0, 1)
    return np.einsum("nx,nx->n", a, np.cross(b, c))


def areas(surface):
    """Area (n,) of the triangles in mm2."""
    return surface.compute_cell_sizes(length=False, volume=False)["Area"]


def middles(surface):
    """Middles (n, 3) of the triangles."""
    return surface.points[surface.regular_faces].mean(axis=1)


def triangle_points(surface, spacing_mm):
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
