"""What was meshed, measured on the mesh, against the table."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.aha import SEGMENTS
from regional_lv.geometry.elements import (
    NODES,
    QUAD_NODES,
    facet_cells,
    facet_normals,
    facet_points,
    gauss,
    jacobians,
    lagrange,
)
from regional_lv.geometry.mesh import ENDOCARDIUM, EPICARDIUM, SURFACES, Mesh
from regional_lv.geometry.surfaces import bullseye


def summarise(mesh: Mesh, table: pd.DataFrame) -> tuple[pd.DataFrame, dict]:
    """(segments, summary): what was meshed, measured on the mesh, against the table.

    segments: a row per AHA segment with volume_ml, thickness_mm and endo_radius_mm (means over
    angle and latitude, as `geometry.surfaces` defines them), the table's values beside them, and
    the number of elements. summary: volumes (mL), counts, the worst deviations (mm) and the scaled
    Jacobian (det J over the product of its columns' lengths; 1 is a brick) at corners, edges,
    faces and Gauss points.
    """
    volume = segment_volumes(mesh)
    owner = facet_cells(mesh)[mesh.surface == ENDOCARDIUM]
    radius, thickness, weight = _endocardial_samples(mesh, table)
    rows = []
    for segment, given in zip(SEGMENTS, table.itertuples(), strict=True):
        w = weight[mesh.segment[owner] == segment.number]
        mean = {
            name: (values[mesh.segment[owner] == segment.number] * w).sum() / w.sum()
            for name, values in (("thickness", thickness), ("endo_radius", radius))
        }
        rows.append(
            {
                "aha_segment": segment.number,
                "name": segment.name,
                "volume_ml": volume[segment.number - 1],
                "thickness_mm": mean["thickness"],
                "thickness_table_mm": given.wall_thickness_mm,
                "endo_radius_mm": mean["endo_radius"],
                "endo_radius_table_mm": given.endo_radius_mm,
                "elements": int((mesh.segment == segment.number).sum()),
            }
        )
    segments = pd.DataFrame(rows)
    deviation = {
        name: float((segments[f"{name}_mm"] - segments[f"{name}_table_mm"]).abs().max())
        for name in ("thickness", "endo_radius")
    }
    summary = summarise_mesh(mesh) | {
        "largest_thickness_deviation_mm": deviation["thickness"],
        "largest_endo_radius_deviation_mm": deviation["endo_radius"],
    }
    return segments, summary


def summarise_mesh(mesh: Mesh) -> dict:
    """Volumes (mL), counts and scaled Jacobians of any mesh."""
    quality = scaled_jacobians(mesh)
    return {
        "cavity_volume_ml": cavity_volume(mesh),
        "wall_volume_ml": float(segment_volumes(mesh).sum()),
        "nodes": len(mesh.points),
        "elements": len(mesh.cells),
        "facets": {name: int((mesh.surface == k).sum()) for k, name in SURFACES.items()},
        "scaled_jacobian_min": float(quality.min()),
        "scaled_jacobian_median": float(np.median(quality)),
        "worst_segment": int(mesh.segment[quality.min(axis=1).argmin()]),
    }


def cell_volumes(mesh: Mesh) -> np.ndarray:
    """Volume (cells,) in mL."""
    points, weights = gauss(3, 4)
    return np.linalg.det(jacobians(mesh, points)) @ weights / 1e3


def segment_volumes(mesh: Mesh) -> np.ndarray:
    """Volume (17,) in mL of the AHA segments."""
    return np.bincount(mesh.segment - 1, cell_volumes(mesh), minlength=len(SEGMENTS))


def scaled_jacobians(mesh: Mesh) -> np.ndarray:
    """Scaled Jacobians (cells, 54) at the 27 nodes and 27 Gauss points of each element."""
    jacobian = jacobians(mesh, np.concatenate([NODES, gauss(3)[0]]))
    return np.linalg.det(jacobian) / np.linalg.norm(jacobian, axis=-2).prod(axis=-1)


def cavity_volume(mesh: Mesh) -> float:
    """Volume (mL) between the endocardium and the base plane, by the divergence theorem."""
    points, weights = gauss(2, 4)
    inner = mesh.surface == ENDOCARDIUM
    normal = facet_normals(mesh, points)[inner]
    x = facet_points(mesh, points)[inner]
    # A plane through the origin adds nothing, as x . n vanishes on it; normals point into the
    # cavity.
    return float(-np.einsum("kqx,kqx,q->", x, normal, weights) / 3e3)


def _endocardial_samples(
    mesh: Mesh, table: pd.DataFrame
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radius, thickness and weight (facets, q) at Gauss points of the endocardial facets."""
    endo = mesh.facets[mesh.surface == ENDOCARDIUM]
    apex, epi_apex = (_apex(mesh, surface) for surface in (ENDOCARDIUM, EPICARDIUM))
    x, y, z = mesh.points.T
    disk = np.stack(bullseye(np.arctan2(y, x), np.arcsin(np.clip(z / apex, 0, 1))), axis=-1)
    points, weights = gauss(2)
    shape, gradient = lagrange(points, QUAD_NODES)
    place = np.einsum("qn,knx->kqx", shape, disk[endo])
    tangents = np.einsum("qnd,knx->kqdx", gradient, disk[endo])
    # d(phi) d(latitude) is the bullseye's area over the distance from its centre.
    weight = np.abs(np.linalg.det(tangents)) * weights / np.linalg.norm(place, axis=-1)

    at = np.einsum("qn,knx->kqx", shape, mesh.points[endo]).reshape(-1, 3)
    phi, u = np.arctan2(at[:, 1], at[:, 0]), np.arcsin(np.clip(at[:, 2] / apex, 0, 1))
    tilt = (apex - epi_apex) / table["wall_thickness_mm"].mean()
    line = np.stack([np.cos(u) * np.cos(phi), np.cos(u) * np.sin(phi), -tilt * np.sin(u)], axis=-1)
    thickness = _distance_to_epicardium(mesh, at, line / np.linalg.norm(line, axis=-1)[:, None])
    radius = np.hypot(at[:, 0], at[:, 1])
    return radius.reshape(weight.shape), thickness.reshape(weight.shape), weight


def _apex(mesh: Mesh, surface: int) -> float:
    """z (mm) of the surface's node nearest the long axis."""
    points = mesh.points[mesh.facets[mesh.surface == surface]].reshape(-1, 3)
    return points[np.hypot(points[:, 0], points[:, 1]).argmin(), 2]


def _distance_to_epicardium(
    mesh: Mesh, origins: np.ndarray, directions: np.ndarray, parts: int = 4
) -> np.ndarray:
    """Distance (n,) along unit directions (n, 3) to the epicardium, NaN where they miss it.

    Origin and direction lie in one meridian plane. Each facet that this plane meets is cut into
    2 parts^2 triangles (Moeller and Trumbore 1997, doi 10.1080/10867651.1997.10487468).
    """
    ticks = np.linspace(-1, 1, parts + 1)
    grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    facets = mesh.facets[mesh.surface == EPICARDIUM]
    x = np.einsum("qn,knx->kqx", lagrange(grid, QUAD_NODES)[0], mesh.points[facets])
    first = (np.arange(parts)[:, None] * (parts + 1) + np.arange(parts)).ravel()
    right, up = first + parts + 1, first + 1
    corners = np.concatenate([np.stack([first, right, up]), np.stack([right + 1, up, right])], 1)
    distance = np.full(len(origins), np.nan)
    for i, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        across = np.array([-origin[1], origin[0], 0.0]) / np.hypot(*origin[:2])
        side = x @ across
        met = x[(side.min(axis=1) < 1e-6) & (side.max(axis=1) > -1e-6)]
        a, b, c = (met[:, k].reshape(-1, 3) for k in corners)
        ab, ac, offset = b - a, c - a, origin - a
        p, q = np.cross(direction, ac), np.cross(offset, ab)
        determinant = np.einsum("nx,nx->n", ab, p)
        determinant[determinant == 0] = np.nan
        v = np.einsum("nx,nx->n", offset, p) / determinant
        w = q @ direction / determinant
        s = np.einsum("nx,nx->n", ac, q) / determinant
        hit = (v >= -1e-9) & (w >= -1e-9) & (v + w <= 1 + 1e-9) & (s > 0)
        if hit.any():
            distance[i] = s[hit].min()
    return distance


def write_table(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table as CSV with six digits."""
    table.to_csv(path, index=False, float_format="%.6g")


def write_summary(summary: Mapping, path: str | Path) -> None:
    """Write a summary as JSON."""
    Path(path).write_text(json.dumps(summary, indent=2) + "\n")
