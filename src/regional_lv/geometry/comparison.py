"""How far a re-meshed ventricle is from the imported one: distances, volumes, segments."""

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from regional_lv.aha import SEGMENTS
from regional_lv.geometry.elements import facet_normals, facet_points, gauss, lagrange, nodes_of
from regional_lv.geometry.mesh import ENDOCARDIUM, EPICARDIUM, SURFACES, Mesh
from regional_lv.geometry.summary import cavity_volume, cell_volumes, segment_volumes

# Distance (mm) between the places at which a surface is sampled.
SPACING_MM = 0.6


def compare(imported: Mesh, remeshed: Mesh) -> pd.DataFrame:
    """Table of what differs: quantity, part, unit, imported, remeshed, difference.

    `distance_max` and `distance_rms` (mm) are between the surfaces, over places on either.
    `volume` (mL) is that of the cavity (of the facets), of the wall and of every segment;
    `volume_elsewhere` the part of an imported segment that lies in another segment of the
    re-meshed ventricle.
    """
    rows = []
    for surface in (ENDOCARDIUM, EPICARDIUM):
        distance = surface_distances(imported, remeshed, surface)
        for what, value in (("max", distance.max()), ("rms", np.sqrt((distance**2).mean()))):
            rows.append((f"distance_{what}", SURFACES[surface], "mm", np.nan, np.nan, value))
    pair = (imported, remeshed)
    volumes = [segment_volumes(mesh) for mesh in pair]
    parts = {"cavity": [cavity_volume(m) for m in pair], "wall": [v.sum() for v in volumes]}
    parts |= {f"segment_{s.number:02d}": [v[s.number - 1] for v in volumes] for s in SEGMENTS}
    rows += [("volume", part, "mL", a, b, b - a) for part, (a, b) in parts.items()]
    for segment, volume in zip(SEGMENTS, volume_in_other_segments(imported, remeshed), strict=True):
        part = f"segment_{segment.number:02d}"
        rows.append(("volume_elsewhere", part, "mL", np.nan, np.nan, volume))
    columns = ["quantity", "part", "unit", "imported", "remeshed", "difference"]
    return pd.DataFrame(rows, columns=columns)


def surface_distances(first: Mesh, second: Mesh, surface: int) -> np.ndarray:
    """Distances (mm) from places on each mesh's surface to the other mesh's surface."""
    here, there = (sample_surface(mesh, surface) for mesh in (first, second))
    return np.concatenate([normal_distances(here[0], *there), normal_distances(there[0], *here)])


def sample_surface(mesh: Mesh, surface: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and unit normals (n, 3) on a surface, about `SPACING_MM` apart."""
    corners = mesh.points[mesh.facets[mesh.surface == surface][:, :4]]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max()
    ticks = np.linspace(-1, 1, int(np.ceil(edge / SPACING_MM)) + 1)
    grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    mine = mesh.surface == surface
    normals = facet_normals(mesh, grid)[mine].reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return facet_points(mesh, grid)[mine].reshape(-1, 3), normals


def normal_distances(points: np.ndarray, places: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Distance (n,) of points (n, 3) from the nearest of the places (m, 3) along its normal."""
    _, nearest = cKDTree(places).query(points)
    return np.abs(np.einsum("nx,nx->n", points - places[nearest], normals[nearest]))


def volume_in_other_segments(imported: Mesh, remeshed: Mesh) -> np.ndarray:
    """Volume (17,) in mL of imported segments whose elements lie in another one when re-meshed."""
    shape, _ = lagrange(gauss(3, 4)[0], nodes_of(remeshed))
    places = np.einsum("qn,enx->eqx", shape, remeshed.points[remeshed.cells])
    centres = imported.points[imported.cells[:, :8]].mean(axis=1)
    _, nearest = cKDTree(places.reshape(-1, 3)).query(centres)
    other = remeshed.segment[nearest // places.shape[1]] != imported.segment
    volume = cell_volumes(imported) * other
    return np.bincount(imported.segment - 1, volume, minlength=len(SEGMENTS))
