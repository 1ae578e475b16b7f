"""Orders at which the discretisation converges: a tube with an exact solution, and the heart.

The tube is a slice of a thick-walled cylinder of Holzapfel and Ogden's material (the heart's own,
if it has this law), fibres turning through the wall by the heart's helix angles, sheets radial.
Inflated between planes that hold it along the axis and around it, it stays a tube: a point at the
distance R from the axis moves to r with r^2 = R^2 + a^2 - A^2, and the pressure is an integral over
R.
"""

import json
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import ufl
from numpy.polynomial import legendre
from scipy.optimize import brentq

from regional_lv.channels import Channels
from regional_lv.geometry.directions import fibre_angles
from regional_lv.mechanics.equilibrium import Rotation
from regional_lv.mechanics.fibres import fibre_directions
from regional_lv.mechanics.materials import material_from_config
from regional_lv.mechanics.materials.holzapfel_ogden import HolzapfelOgden
from regional_lv.units import KPA_PER_MMHG
from regional_lv.verification.body import Body, block

INNER, OUTER = 20.0, 30.0
"""Radii of the tube (mm): a ventricle's."""

LENGTH, SECTOR = 5.0, np.pi / 6
"""Length (mm) and angle (rad) of the slice; the solution is the same all along and around."""

TUBE_MESHES = (2, 4, 6, 8, 10)
"""Elements through the wall and around the slice; half as many along the axis."""

ORDERS = {
    "cavity volume": 4,
    "mean circumferential strain": 4,
    "mean radial strain": 4,
    "displacement (L2)": 3,
    "circumferential strain (L2)": 2,
}
"""What theory promises of quadratic displacements on smooth problems: h^3 for the field, h^2 for
its gradient, twice the gradient's order for smooth functionals such as volume and mean strains."""


class Tube:
    """The exact solution; lengths in mm, pressure in mmHg, strains have the loaded state as
    their reference, as the heart's do.

    `physics` holds the config sections `material`, `fibres` and `loading`. The solution is one of
    Holzapfel and Ogden's law: a study with another law has that law's reference values here.
    """

    def __init__(self, physics: dict):
        material = physics["material"]
        own = material["law"] == HolzapfelOgden.name
        self.material = material_from_config(material) if own else HolzapfelOgden()
        self.constants = self.material.scaled(dict.fromkeys(self.material.references, 1.0))
        self.fibres = physics["fibres"] | {"sheet_endo_deg": 0.0, "sheet_epi_deg": 0.0}
        self.pressure = physics["loading"]["pressure_mmhg"]
        nodes, weights = legendre.leggauss(80)
        self._R = (INNER + OUTER + (OUTER - INNER) * nodes) / 2
        self._dR = (OUTER - INNER) / 2 * weights
        # Far less is needed than five times the radius, at which exponentials would overflow.
        self.radius = brentq(lambda a: self.pressure_at(a) - self.pressure, INNER, 2 * INNER)

    def pressure_at(self, radius: float) -> float:
        """Pressure that widens the tube from the inner radius INNER to `radius`.

        Equilibrium across the wall, d(s_rr) / dr = (s_tt - s_rr) / r; sheets shorten and carry
        nothing.
        """
        k, R = self.constants, self._R
        depth = (R - INNER) / (OUTER - INNER)
        angles = fibre_angles(self.fibres)
        endo, epi = angles["helix_endo"], angles["helix_epi"]
        around = np.cos(endo + (epi - endo) * depth) ** 2
        stretch = 1 + (radius**2 - INNER**2) / R**2  # (r / R)^2
        matrix = k["a_kpa"] * np.exp(k["b"] * (stretch + 1 / stretch - 2))
        matrix *= stretch - 1 / stretch
        tension = (stretch - 1) * around
        fibre = 2 * k["a_f_kpa"] * tension * np.exp(k["b_f"] * tension**2) * stretch * around
        return ((matrix + fibre) / (R * stretch)) @ self._dR / KPA_PER_MMHG

    @property
    def shift(self) -> float:
        """r^2 - R^2, the same in the whole wall."""
        return self.radius**2 - INNER**2

    def quantities(self) -> dict[str, float]:
        """Exact values of those of `ORDERS` that are numbers; volume in mm^3, of the slice."""
        R = self._R
        stretch = 1 + self.shift / R**2
        weight = 2 * R * self._dR / (OUTER**2 - INNER**2)
        return {
            "cavity volume": SECTOR / 2 * self.radius**2 * LENGTH,
            "mean circumferential strain": ((1 / stretch - 1) / 2) @ weight,
            "mean radial strain": ((stretch - 1) / 2) @ weight,
        }

    def body(self, layers: int) -> Body:
        """The discrete tube with `layers` (even) elements through the wall."""

        def place(unit):
            R, angle = INNER + (OUTER - INNER) * unit[:, 0], SECTOR * unit[:, 1]
            return np.stack([R * np.cos(angle), R * np.sin(angle), LENGTH * unit[:, 2]], axis=-1)

        points, cells = block((layers, layers, layers // 2), place)
        inside = np.hypot(points[:, 0], points[:, 1]) < INNER + 1e-6

        def energy(F, domain):
            fibre, sheet = fibre_directions(depth(domain), self.fibres)
            return self.material.energy(F, fibre, sheet, self.constants)

        return Body(points, cells, inside, energy, _cut_planes)


def depth(domain):
    """Depth in the tube's wall (UFL), 0 inside to 1 outside."""
    x = ufl.SpatialCoordinate(domain)
    return (ufl.sqrt(x[0] ** 2 + x[1] ** 2) - INNER) / (OUTER - INNER)


def _cut_planes(dofs, nodes):
    """Supports of the slice: on its four plane faces nothing moves around or along the axis."""
    x, y, z = nodes.T
    angle = np.arctan2(y, x)
    held = (np.minimum(angle, z) < 1e-9) | (angle > SECTOR - 1e-9) | (z > LENGTH - 1e-9)
    radial, around, axial = dofs[held].T
    return np.concatenate([around, axial]), Rotation(radial, around, angle[held])


def run(physics: dict, hearts: Sequence[str | Path]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Errors of the tube and of the heart, and the orders fitted to them.

    hearts: three summaries of `simulations.solve_baseline`, on meshes of the same heart with one,
    two and three times as many elements in every direction. Errors: body, layers (elements
    through the wall), unknowns, quantity, error (relative). Orders: body, quantity, order and,
    where a smooth solution lets theory promise one, theory.
    """
    tube = run_tube(physics)
    heart, heart_orders = _refined_heart([json.loads(Path(p).read_text()) for p in hearts])
    return pd.concat([tube, heart]), pd.concat([tube_orders(tube), heart_orders])


def verify_convergence(
    hearts: Sequence[str | Path], physics: dict, errors: str | Path, orders: str | Path
) -> None:
    """Write the tables that `run` returns (CSV)."""
    found, fitted = run(physics, hearts)
    found.to_csv(errors, index=False)
    fitted.to_csv(orders, index=False)


def run_tube(physics: dict, meshes=TUBE_MESHES) -> pd.DataFrame:
    """Relative errors of the tube on its meshes, as `run` returns them."""
    tube = Tube(physics)
    rows = []
    for layers in meshes:
        body = tube.body(layers)
        w = body.inflate(tube.pressure * KPA_PER_MMHG, physics["solver"])
        rows += [("tube", layers, body.size, *e) for e in _errors(tube, body, w).items()]
    return pd.DataFrame(rows, columns=["body", "layers", "unknowns", "quantity", "error"])


def tube_orders(errors: pd.DataFrame) -> pd.DataFrame:
    """Slopes of log error over log element size on the three finest meshes."""
    rows = []
    for quantity, theory in ORDERS.items():
        mine = errors[errors["quantity"] == quantity].nlargest(3, "layers")
        slope = np.polyfit(np.log(mine["layers"]), np.log(mine["error"]), 1)[0]
        rows.append(("tube", quantity, -slope, theory))
    return pd.DataFrame(rows, columns=["body", "quantity", "order", "theory"])


def _errors(tube: Tube, body: Body, w: np.ndarray) -> dict[str, float]:
    """Relative error of every quantity of `ORDERS` at the field `w`."""
    x = ufl.SpatialCoordinate(body.domain)
    square = x[0] ** 2 + x[1] ** 2
    stretch = 1 + tube.shift / square  # (r / R)^2
    u = (ufl.sqrt(stretch) - 1) * ufl.as_vector([x[0], x[1], 0.0])
    radial = ufl.as_vector([x[0], x[1], 0.0]) / ufl.sqrt(square)
    around = ufl.as_vector([-radial[1], radial[0], 0.0])
    # The simulator's strains, along directions that do not turn here.
    back = ufl.det(body.F) * ufl.inv(body.F)
    strain_c, strain_r = ((ufl.dot(back * q, back * q) - 1) / 2 for q in (around, radial))
    volume = body.integral(w, 1.0 * body.dx)

    def norm(form):
        return np.sqrt(body.integral(w, ufl.inner(form, form) * body.dx))

    exact = tube.quantities()
    found = {
        "cavity volume": body.cavity(w, lambda y: ufl.as_vector([y[0], y[1], 0.0]) / 2),
        "mean circumferential strain": body.integral(w, strain_c * body.dx) / volume,
        "mean radial strain": body.integral(w, strain_r * body.dx) / volume,
    }
    pointwise = (1 / stretch - 1) / 2
    return {name: abs(value / exact[name] - 1) for name, value in found.items()} | {
        "displacement (L2)": norm(body.u - u) / norm(u),
        "circumferential strain (L2)": norm(strain_c - pointwise) / norm(pointwise),
    }


def _refined_heart(summaries: list[dict]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Errors and orders of the heart at theta = 1 from one, two and three times its elements.

    With Q(k) = Q + c k^-p for k times the elements, the steps between meshes give p, and p the
    limit Q that errors are measured from. Strains are vectors of 17 segments.
    """
    channels = Channels.parse(summaries[0]["observables_theta_1"])
    names = {}
    for kind in dict.fromkeys(channel.kind for channel in channels):
        what = f"segments' {kind.name} strain" if kind.is_strain else f"cavity {kind.name}"
        names[what] = [c.name for c in channels if c.kind is kind]
    errors, orders = [], []
    for quantity, outputs in names.items():
        values = np.array([[s["observables_theta_1"][o] for o in outputs] for s in summaries])
        first, second = (np.linalg.norm(b - a) for a, b in pairwise(values))
        p = _order(float(first / second))
        limit = values[2] + (values[2] - values[1]) * 3**-p / (2**-p - 3**-p)
        orders.append(("heart", quantity, p, np.nan))
        for k, (summary, value) in enumerate(zip(summaries, values, strict=True), start=1):
            error = np.linalg.norm(value - limit) / np.linalg.norm(limit)
            errors.append(("heart", k, summary["unknowns"], quantity, error))
    return (
        pd.DataFrame(errors, columns=["body", "layers", "unknowns", "quantity", "error"]),
        pd.DataFrame(orders, columns=["body", "quantity", "order", "theory"]),
    )


def _order(ratio: float) -> float:
    """p for which (1 - 2^-p) / (2^-p - 3^-p) is `ratio`; NaN if the steps do not shrink so."""

    def gap(p):
        return (1 - 2**-p) / (2**-p - 3**-p) - ratio

    return brentq(gap, 0.01, 10) if gap(0.01) < 0 < gap(10) else np.nan
