"""Two problems of the cardiac mechanics benchmark (Land et al. 2015, doi 10.1098/rspa.2015.0641).

The problems are as in the benchmark's own description (`description/mechbench.tex` in its data
repository, github.com/OpenHeartDevelopers/vgurev-mechbench); lengths in mm, stresses in kPa. What
its participants found is in `data/land_2015.csv`.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import ufl

from regional_lv.mechanics.materials.guccione import Guccione
from regional_lv.verification.body import Body, block, join

BEAM_MESHES = ((5, 1, 1), (10, 1, 1), (20, 2, 2), (40, 4, 4))
"""Elements along x, y and z."""

ELLIPSOID_MESHES = ((2, 6, 1), (3, 9, 2), (4, 12, 3))
"""Elements along a side of the patch at the apex (a quarter of those around), from the patch to
the base, and through the wall."""

GRADING = 1.75
"""How much longer than the mean the first row of elements at the patch is; the last is as much
shorter."""


def guccione(F, c, b_f, b_t, b_fs, fibre):
    """Strain energy density (kPa) of the law `materials.Guccione` with these constants."""
    law = Guccione({"c_kpa": c, "b_f": b_f, "b_t": b_t, "b_fs": b_fs})
    return law.energy(F, fibre, None, law.scaled({"C_c": 1.0, "C_b": 1.0}))


def _clamped(where):
    """Supports that hold all nodes for which `where` (of nodes (n, 3)) is true."""
    return lambda dofs, nodes: (dofs[where(nodes)].ravel(),)


def beam(shape: tuple[int, int, int]) -> Body:
    """Problem 1: a beam of 10 x 1 x 1 mm, clamped at x = 0, pressure on the face z = 0."""
    points, cells = block(shape, lambda unit: unit * [10.0, 1.0, 1.0])
    return Body(
        points,
        cells,
        points[:, 2] == 0.0,
        lambda F, domain: guccione(F, 2.0, 8.0, 2.0, 4.0, ufl.as_vector([1.0, 0.0, 0.0])),
        _clamped(lambda nodes: nodes[:, 0] < 1e-9),
    )


def ellipsoid(shape: tuple[int, int, int]) -> Body:
    """Problem 2: a truncated ellipsoid, clamped at its base z = 5 mm, pressure in its cavity.

    The energy is that of F without its dilation, as most participants have it: next to the clamped
    edge the discrete det F is far from 1, and this energy alone is too soft against compression
    (from about 3 kPa on there was no convergence on meshes with two layers).
    """
    disk, cells = bullseye(*shape)

    def energy(F, domain):
        axis = ufl.as_vector([0.0, 0.0, 1.0])  # any: the material is isotropic
        return guccione(ufl.det(F) ** (-1 / 3) * F, 10.0, 1.0, 1.0, 1.0, axis)

    return Body(
        on_ellipsoids(disk),
        cells,
        disk[:, 2] == 0.0,
        energy,
        _clamped(lambda nodes: nodes[:, 2] > 5.0 - 1e-9),
    )


def bullseye(side: int, rows: int, layers: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (X, Y, depth) and cells of the unit disk by the unit interval.

    A rounded square of `side` by `side` elements in the middle, a node at its centre, and `rows`
    of elements from each of its sides to the rim: no element has an edge of no length. The rows
    narrow towards the rim, whose clamped edge is singular.
    """

    def square(a, b):
        # Between a square and a disk; its corners are on the diagonals.
        share = GRADING * side / (GRADING * side + 2 * rows)
        return share * np.stack([a * np.sqrt(1 - b**2 / 4), b * np.sqrt(1 - a**2 / 4)], axis=-1)

    def middle(unit):
        return np.column_stack([square(*(2 * unit[:, :2] - 1).T), unit[:, 2]])

    def sector(quarter):
        turn = np.round([[np.cos(quarter), np.sin(quarter)], [-np.sin(quarter), np.cos(quarter)]])

        def place(unit):
            out, b, depth = unit.T
            out, b = out * (GRADING - (GRADING - 1) * out), 2 * b - 1
            rim = np.stack([np.cos(np.pi / 4 * b), np.sin(np.pi / 4 * b)], axis=-1)
            flat = (1 - out)[:, None] * square(np.ones(len(b)), b) + out[:, None] * rim
            return np.column_stack([flat @ turn, depth])

        return place

    return join(
        [block((side, side, layers), middle)]
        + [block((rows, side, layers), sector(k * np.pi / 2)) for k in range(4)]
    )


def on_ellipsoids(disk: np.ndarray) -> np.ndarray:
    """The bullseye's points (n, 3) between the benchmark's two ellipsoids (mm), apex downwards."""
    x, y, depth = disk.T
    short, long = 7 + 3 * depth, 17 + 3 * depth
    rho = np.hypot(x, y)
    angle = rho * (np.pi - np.arccos(5 / long))  # from the apex
    # sin(angle) / rho is smooth in the centre.
    stretch = np.divide(np.sin(angle), rho, out=np.zeros_like(rho), where=rho > 0)
    # x and y change places, because depth points down at the apex: cells stay right-handed.
    return np.stack([short * y * stretch, short * x * stretch, -long * np.cos(angle)], axis=-1)


def run(settings: dict, beams=BEAM_MESHES, ellipsoids=ELLIPSOID_MESHES) -> pd.DataFrame:
    """Both problems on their meshes: a row per mesh with problem, mesh, unknowns and the results.

    `settings` is the config's section `solver`. Results are named as in `data/land_2015.csv`,
    those of the other problem NaN.
    """
    rows = []
    for shape in beams:
        body = beam(shape)
        w = body.inflate(0.004, settings)
        tip = body.deformed(w, (10.0, 0.5, 1.0))
        rows.append(_row("beam", shape, body) | {"tip_z_mm": tip[2]})
    for shape in ellipsoids:
        body = ellipsoid(shape)
        w = body.inflate(10.0, settings)
        rows.append(
            _row("ellipsoid", shape, body)
            | {
                "endo_apex_z_mm": body.deformed(w, (0.0, 0.0, -17.0))[2],
                "epi_apex_z_mm": body.deformed(w, (0.0, 0.0, -20.0))[2],
                # The base's plane closes the cavity; the field is parallel to it there.
                "cavity_mm3": body.cavity(w, lambda x: ufl.as_vector([0.0, 0.0, x[2] - 5.0])),
            }
        )
    return pd.DataFrame(rows)


def verify_land(solver: dict, results: str | Path) -> None:
    """Solve both problems and write the table of `run` (CSV)."""
    run(solver).to_csv(results, index=False)


def _row(problem: str, shape: tuple, body: Body) -> dict:
    return {
        "problem": problem,
        "mesh": "x".join(map(str, shape)),
        "unknowns": body.size,
    }
