"""The strains of one solution at every integration point, not only their segment means."""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from regional_lv import aha
from regional_lv.geometry.elements import gauss, jacobians, lagrange, nodes_of
from regional_lv.geometry.mesh import Mesh, read_mesh, write_mesh
from regional_lv.simulations import make_runner

POINTS_PER_EDGE = 3
"""Gauss points along each edge of a cell: those at which the simulator integrates."""


def map_strains(mesh: Path, physics: dict, predictor: Path, table: Path, vtu: Path) -> None:
    """Simulate theta = 1 and write its strains.

    table: Parquet of `strain_field`. vtu: the mesh (reference state) with `displacement` (mm) and
    each cell's mean strains, for ParaView. Raises RuntimeError if the simulation fails.
    """
    runner = make_runner(mesh, physics, predictor)
    result = runner.run(np.ones(len(aha.PARAMETERS)))
    if result.state is None:
        raise RuntimeError(f"the simulation at theta = 1 failed: {result.reason}")
    geometry = read_mesh(mesh)
    moved = nodal_displacement(runner.solver.simulator, result.state.w, geometry.points)
    field = strain_field(geometry, moved)
    field.to_parquet(table, index=False)
    means = cell_means(field)
    write_mesh(geometry, vtu, {"displacement": moved}, {q: means[q].to_numpy() for q in means})


def nodal_displacement(simulator, w: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Displacement (n, 3) in mm of the simulator's field `w` at mesh nodes `points` (n, 3)."""
    distance, node = cKDTree(simulator.displacement_nodes).query(points)
    if distance.max() > 1e-6:
        raise ValueError("these points are not the nodes of the displacement")
    return w[simulator.displacement_dofs[node]]


def strain_field(mesh: Mesh, displacement: np.ndarray) -> pd.DataFrame:
    """Green strains that look back from the deformed state, at the Gauss points of every cell.

    displacement: (n, 3) mm at the mesh's nodes. Columns: cell and point (numbers, cells in the
    mesh's order, points with the last reference coordinate fastest), segment (AHA), volume_mm3 (of
    the wall in the reference state, what a segment mean weights with), circumferential, radial,
    longitudinal. The definitions are the simulator's (`Simulator._build_observables`), with which
    the segment means of this table agree.
    """
    points, weights = gauss(3, POINTS_PER_EDGE)
    shape_gradient = lagrange(points, nodes_of(mesh))[1]
    jacobian = jacobians(mesh, points)
    local = np.einsum("qnd,eqdx->eqnx", shape_gradient, np.linalg.inv(jacobian), optimize=True)
    gradient = np.einsum("enc,eqnx->eqcx", displacement[mesh.cells], local, optimize=True)
    deformation = np.eye(3) + gradient
    # The adjugate is the inverse where the wall keeps its volume; see the simulator.
    back = np.linalg.det(deformation)[..., None, None] * np.linalg.inv(deformation)
    depth = np.einsum("en,eqnx->eqx", mesh.transmural[mesh.cells], local, optimize=True)
    directions = _directions(np.einsum("eqij,eqi->eqj", back, depth))
    cells, count = deformation.shape[:2]
    table = pd.DataFrame(
        {
            "cell": np.repeat(np.arange(cells), count),
            "point": np.tile(np.arange(count), cells),
            "segment": np.repeat(mesh.segment, count),
            "volume_mm3": (np.linalg.det(jacobian) * weights).ravel(),
        }
    )
    for name, direction in zip(aha.DIRECTIONS, directions, strict=True):
        stretched = np.einsum("eqij,eqj->eqi", back, direction)
        table[name] = ((stretched**2).sum(axis=-1).ravel() - 1) / 2
    return table


def _directions(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Circumferential, radial and longitudinal unit vectors (..., 3) of the deformed state."""
    radial = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    horizontal = np.stack([-radial[..., 1], radial[..., 0], 0 * radial[..., 0]], axis=-1)
    length = np.sqrt((horizontal**2).sum(axis=-1, keepdims=True) + 1e-16)
    circumferential = horizontal / length
    return circumferential, radial, np.cross(radial, circumferential)


def cell_means(field: pd.DataFrame) -> pd.DataFrame:
    """Volume averages of `strain_field` over each cell: a row per cell, a column per direction."""
    weighted = field[list(aha.DIRECTIONS)].mul(field["volume_mm3"], axis=0)
    volume = field.groupby("cell")["volume_mm3"].sum()
    return weighted.groupby(field["cell"]).sum().div(volume, axis=0)
