"""The left ventricle's inflation as a finite element problem: residual, tangent, observables.

Quadratic hexahedra for displacement and linear pressure (u-p, incompressible), follower pressure
on the endocardium, supported base. This module knows one equilibrium problem; how a solution is
reached is the business of `continuation`.
"""

from dataclasses import dataclass

import numpy as np
import ufl
from petsc4py import PETSc
from scipy.spatial import cKDTree

from regional_lv import aha
from regional_lv.geometry.mesh import BASE, ENDOCARDIUM, Mesh
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.mechanics.material import HolzapfelOgden, strain_energy

KPA_PER_MMHG = 0.133322387415
QUADRATURE_DEGREE = 5  # three Gauss points per direction

LAYERS = {
    "wall": (0.0, 1.0),
    "endocardium": (0.0, 1 / 3),
    "midwall": (1 / 3, 2 / 3),
    "epicardium": (2 / 3, 1.0),
}
"""Transmural bounds (0 endocardium, 1 epicardium) over which strains are averaged."""


class LinearSolveError(ArithmeticError):
    """The tangent could not be factorised, or a field is no longer finite."""


@dataclass(frozen=True)
class State:
    """A solution: degrees of freedom `w`, parameters `theta` (10,) and `pressure` (mmHg)."""

    w: np.ndarray
    theta: np.ndarray
    pressure: float


class Simulator:
    """Equilibrium of one left ventricle for any theta and pressure.

    Parameters
    ----------
    mesh: geometry with segments, surfaces and the transmural coordinate (mm).
    config: the study's config; reads `material`, `fibres`, `loading`, `observables`.
    """

    def __init__(self, mesh: Mesh, config: dict):
        self.domain, origin = api.hexahedral_mesh(mesh.points, mesh.cells)
        self.segment = mesh.segment[origin] - 1
        self.zone = aha.SEGMENT_ZONE[self.segment]
        api.require_cellwise_order(self.domain)
        self.space = api.mixed_space(self.domain)
        self.w = api.fem.Function(self.space)
        self.size = len(self.w.x.array)
        self._build_forms(mesh, config)
        self._build_constraints(mesh, config["loading"]["base"])
        self._build_linear_solver()

    # ---------------------------------------------------------------- the weak form

    def _build_forms(self, mesh: Mesh, config: dict) -> None:
        domain, loading = self.domain, config["loading"]
        quadrature = {"quadrature_degree": QUADRATURE_DEGREE}
        tags = api.facet_tags(domain, mesh.facets[:, :4], mesh.surface)
        dx = ufl.Measure("dx", domain, metadata=quadrature)
        ds = ufl.Measure("ds", domain, subdomain_data=tags, metadata=quadrature)
        u, p = ufl.split(self.w)
        F = ufl.Identity(3) + ufl.grad(u)
        J = ufl.det(F)

        self.c_a, self.c_b = (api.fem.Function(api.space(domain, "DG", 0)) for _ in range(2))
        self.pressure_kpa = api.fem.Constant(domain, 0.0)
        transmural = api.fem.Function(api.space(domain, "Lagrange", 2))
        transmural.x.array[:] = _nodal_values(transmural, mesh)
        fibre, sheet = fibre_directions(transmural, config["fibres"])

        reference = HolzapfelOgden.from_config(config["material"])
        energy = strain_energy(F, fibre, sheet, reference, self.c_a, self.c_b)
        test = ufl.TestFunction(self.space)
        v, _ = ufl.split(test)
        stored = (energy + p * (J - 1)) * dx
        internal = ufl.derivative(stored, self.w, test)
        # Nanson: the deformed normal times the deformed area, per reference area.
        normal = J * ufl.inv(F).T * ufl.FacetNormal(domain)
        residual = internal + self.pressure_kpa * ufl.inner(normal, v) * ds(ENDOCARDIUM)
        if loading["base"] == "radial_spring":
            radial = _radial_direction(domain)
            stiffness = loading["base_spring_kpa_per_mm"]
            residual += stiffness * ufl.dot(u, radial) * ufl.dot(v, radial) * ds(BASE)
        trial = ufl.TrialFunction(self.space)
        self._residual = api.compile_form(residual)
        self._tangent = api.compile_form(ufl.derivative(residual, self.w, trial))
        load = ufl.inner(normal, v) * ds(ENDOCARDIUM)
        self._load = api.compile_form(load)

        # d(residual)/d(log C) of one zone: the same kernel on that zone's cells only.
        self._parameter_forms = []
        for zone in range(len(aha.ZONES)):
            cells = api.cell_tags(domain, np.flatnonzero(self.zone == zone))
            dz = ufl.Measure("dx", domain, subdomain_data=cells, metadata=quadrature)
            in_zone = ufl.derivative((energy + p * (J - 1)) * dz(1), self.w, test)
            for factor in (self.c_a, self.c_b):
                form = ufl.derivative(in_zone, factor, factor)
                self._parameter_forms.append(api.compile_form(form))

        self._build_observables(transmural, u, F, J, dx, ds, config["observables"]["region"])

    def _build_observables(self, transmural, u, F, J, dx, ds, region: str) -> None:
        domain = self.domain
        # Strains look back from the end-diastolic configuration, E = (F^-T F^-1 - I) / 2, along
        # directions of that configuration: the wall's normal there, the horizontal tangent, and
        # the tangent across it.
        # The wall keeps its volume, so the adjugate J F^-1 is the inverse; where the discrete
        # J strays from 1, next to the held edge of the base, it does not blow the error up.
        back = J * ufl.inv(F)
        directions = local_directions(back.T * ufl.grad(transmural))
        strains = [(ufl.dot(back * q, back * q) - 1) / 2 for q in directions]
        lower, upper = LAYERS[region]
        inside = ufl.And(ufl.ge(transmural, lower), ufl.le(transmural, upper))
        weight = ufl.conditional(inside, 1.0, 0.0)

        per_cell = api.space(domain, "DG", 0, components=3)
        cellwise = ufl.TestFunction(per_cell)
        strain = weight * ufl.inner(ufl.as_vector(strains), cellwise) * dx
        self._direction = api.fem.Function(self.space)
        self._strain = api.compile_form(strain)
        self._strain_derivative = api.compile_form(ufl.derivative(strain, self.w, self._direction))
        scalar = api.space(domain, "DG", 0)
        measure = api.compile_form(weight * ufl.TestFunction(scalar) * dx)
        volumes = api.assemble_vector(np.zeros(len(self.segment)), measure)
        self.segment_volume = np.bincount(self.segment, volumes, minlength=17)

        # Divergence theorem with the field (0, 0, z): the lid at the base, z = 0, adds nothing.
        z = ufl.SpatialCoordinate(domain)[2] + u[2]
        cavity = -z * (J * ufl.inv(F).T * ufl.FacetNormal(domain))[2] * ds(ENDOCARDIUM)
        self._cavity = api.compile_form(cavity)
        self._cavity_gradient = api.compile_form(
            ufl.derivative(cavity, self.w, ufl.TestFunction(self.space))
        )
        self._dilation = api.compile_form(abs(J - 1) * dx)

    # ------------------------------------------------------------- supports and algebra

    def _build_constraints(self, mesh: Mesh, base: str) -> None:
        """Constrained degrees of freedom, in cylindrical components on the base."""
        dofs, coordinates = zip(
            *(api.tabulated_dofs(self.space.sub(0).sub(i)) for i in range(3)), strict=True
        )
        order = [np.lexsort(np.round(x, 6).T) for x in coordinates]
        dofs = np.stack([d[o] for d, o in zip(dofs, order, strict=True)], axis=1)
        nodes = coordinates[0][order[0]]
        self.displacement_dofs, self.displacement_nodes = dofs, nodes
        on_base = np.flatnonzero(np.abs(nodes[:, 2] - nodes[:, 2].max()) < 1e-6)
        angle = np.arctan2(nodes[on_base, 1], nodes[on_base, 0])
        # Rotating x, y into r, theta on the base makes supports plain rows and columns.
        self._x, self._y = dofs[on_base, 0], dofs[on_base, 1]
        self._cos, self._sin = np.cos(angle), np.sin(angle)
        fixed = [dofs[on_base, 2]]
        if base in ("u_r_u_z_fixed", "fixed"):
            fixed.append(self._x)
        if base in ("u_z_u_theta_fixed", "fixed"):
            fixed.append(self._y)
        if base in ("u_r_u_z_fixed", "radial_spring"):
            # Equilibrium leaves the rotation about the long axis free, and no load turns: holding
            # one node removes it without any reaction. A spring leaves translation to the springs.
            fixed.append(self._y[:1])
        self.fixed = np.unique(np.concatenate(fixed))

    def _build_linear_solver(self) -> None:
        self._matrix = api.create_matrix(self._tangent)
        indptr = np.asarray(self._matrix.indptr).astype(np.int32)
        indices = np.asarray(self._matrix.indices).astype(np.int32)
        self._data = np.asarray(self._matrix.data)
        rows = np.repeat(np.arange(self.size, dtype=np.int32), np.diff(indptr))
        fixed = np.zeros(self.size, dtype=bool)
        fixed[self.fixed] = True
        self._fixed_entries = np.flatnonzero(fixed[rows] | fixed[indices])
        self._fixed_diagonal = np.flatnonzero(fixed[rows] & (rows == indices))

        # Positions of the entries that the rotation of base nodes mixes: pairs of rows, then of
        # columns.
        def span(dofs):
            return [slice(indptr[d], indptr[d + 1]) for d in dofs]

        entries = np.arange(len(indices))
        sorter = [entries[s][np.argsort(indices[s], kind="stable")] for s in span(self._x)]
        partner = [entries[s][np.argsort(indices[s], kind="stable")] for s in span(self._y)]
        self._row_pairs = np.concatenate(sorter), np.concatenate(partner)
        lengths = [len(s) for s in sorter]
        self._row_rotation = np.repeat(self._cos, lengths), np.repeat(self._sin, lengths)

        place = np.full(self.size, -1)
        place[self._x] = place[self._y] = np.arange(len(self._x))
        column_x = np.flatnonzero(np.isin(indices, self._x))
        column_y = np.flatnonzero(np.isin(indices, self._y))
        key_x = np.lexsort((place[indices[column_x]], rows[column_x]))
        key_y = np.lexsort((place[indices[column_y]], rows[column_y]))
        self._column_pairs = column_x[key_x], column_y[key_y]
        node = place[indices[self._column_pairs[0]]]
        self._column_rotation = self._cos[node], self._sin[node]

        self._petsc_matrix = None
        self._pattern = indptr, indices
        self._reset_solver()

    def _reset_solver(self) -> None:
        """Build matrix and factorisation anew: after NaN, the old ones no longer work."""
        self._petsc_matrix = PETSc.Mat().createAIJWithArrays(
            (self.size, self.size), (*self._pattern, self._data), comm=PETSc.COMM_SELF
        )
        self._ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        self._ksp.setOperators(self._petsc_matrix)
        self._ksp.setType("preonly")
        self._ksp.getPC().setType("lu")
        self._ksp.getPC().setFactorSolverType("mumps")
        self._ksp.setErrorIfNotConverged(False)
        self._rhs, self._solution = self._petsc_matrix.createVecs()

    def _rotate(self, vector: np.ndarray, sign: float = 1.0) -> np.ndarray:
        """Base nodes from x, y to r, theta (`sign` 1) or back (-1), in place."""
        x, y = vector[self._x].copy(), vector[self._y].copy()
        vector[self._x] = self._cos * x + sign * self._sin * y
        vector[self._y] = self._cos * y - sign * self._sin * x
        return vector

    # --------------------------------------------------------------------- the problem

    def set(self, theta: np.ndarray, pressure: float) -> None:
        """Set the scaling factors theta (10,) and the cavity pressure (mmHg)."""
        theta = np.asarray(theta, dtype=float).reshape(5, 2)
        self.c_a.x.array[:] = theta[self.zone, 0]
        self.c_b.x.array[:] = theta[self.zone, 1]
        self.pressure_kpa.value = pressure * KPA_PER_MMHG

    def residual(self, w: np.ndarray) -> np.ndarray:
        """Residual (size,) in kPa mm^2, base nodes in cylindrical components, supports zero."""
        self.w.x.array[:] = w
        vector = self._rotate(api.assemble_vector(np.zeros(self.size), self._residual))
        vector[self.fixed] = 0.0
        return vector

    def factorise(self, w: np.ndarray) -> None:
        """Assemble and factorise the tangent at `w`; `solve` then uses it."""
        self.w.x.array[:] = w
        api.assemble_matrix(self._matrix, self._tangent)
        if not np.isfinite(self._data).all():
            raise LinearSolveError("the tangent is not finite")
        self.constrain(self._data)
        self._petsc_matrix.assemble()
        self._ksp.setOperators(self._petsc_matrix)
        try:
            self._ksp.getPC().setUp()
        except PETSc.Error as error:
            self._reset_solver()
            raise LinearSolveError("the tangent could not be factorised") from error

    def constrain(self, data: np.ndarray) -> None:
        """Rotate base rows and columns of the tangent's entries and put supports in, in place."""
        for (a, b), (cos, sin) in (
            (self._row_pairs, self._row_rotation),
            (self._column_pairs, self._column_rotation),
        ):
            x, y = data[a], data[b]
            data[a], data[b] = cos * x + sin * y, cos * y - sin * x
        data[self._fixed_entries] = 0.0
        data[self._fixed_diagonal] = 1.0

    def solve(self, vector: np.ndarray) -> np.ndarray:
        """Solve with the last factorised tangent; `vector` as `residual` gives it."""
        self._rhs.setArray(vector)
        self._ksp.solve(self._rhs, self._solution)
        solution = self._solution.getArray().copy()
        if not np.isfinite(solution).all():
            self._reset_solver()
            raise LinearSolveError("the Newton step is not finite")
        return self._rotate(solution, -1.0)

    # -------------------------------------------------------------- what is observed

    def observables(self, w: np.ndarray) -> np.ndarray:
        """The 52 outputs of `aha.OUTPUTS` (volume in mL, Green strains) at `w`."""
        self.w.x.array[:] = w
        volume = api.fem.assemble_scalar(self._cavity) / 1000.0
        return np.concatenate([[volume], self._segment_means(self._strain)])

    def field_sensitivities(self, w: np.ndarray) -> np.ndarray:
        """d(w)/d(log theta), (10, size), by back-substitution with the factor at hand."""
        self.w.x.array[:] = w
        rows = []
        for form in self._parameter_forms:
            vector = self._rotate(api.assemble_vector(np.zeros(self.size), form))
            vector[self.fixed] = 0.0
            rows.append(-self.solve(vector))
        return np.stack(rows)

    def pressure_sensitivity(self, w: np.ndarray) -> np.ndarray:
        """d(w)/d(pressure), (size,), per mmHg, with the factor at hand."""
        self.w.x.array[:] = w
        vector = self._rotate(api.assemble_vector(np.zeros(self.size), self._load))
        vector[self.fixed] = 0.0
        return -KPA_PER_MMHG * self.solve(vector)

    def directional_derivatives(self, w: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Derivatives (k, 52) of the outputs at `w` along fields `directions` (k, size)."""
        self.w.x.array[:] = w
        gradient = api.assemble_vector(np.zeros(self.size), self._cavity_gradient) / 1000.0
        rows = []
        for direction in directions:
            self._direction.x.array[:] = direction
            strains = self._segment_means(self._strain_derivative)
            rows.append(np.concatenate([[gradient @ direction], strains]))
        return np.stack(rows)

    def dilation(self, w: np.ndarray) -> float:
        """Volume average of |det F - 1|, zero for an incompressible wall."""
        self.w.x.array[:] = w
        return api.fem.assemble_scalar(self._dilation) / self.segment_volume.sum()

    def _segment_means(self, form) -> np.ndarray:
        values = api.assemble_vector(np.zeros(3 * len(self.segment)), form)
        sums = np.stack(
            [np.bincount(self.segment, column, minlength=17) for column in values.reshape(-1, 3).T]
        )
        return (sums / self.segment_volume).ravel()


def local_directions(transmural_gradient):
    """Circumferential, radial and longitudinal unit vectors of a configuration.

    The radial direction is the normal of the surfaces of equal depth, pointing outwards; the
    circumferential one is horizontal and counter-clockwise seen from the base; the longitudinal
    one points to the base. Only where the normal is exactly vertical, a single point near the
    apex, is the circumferential direction not defined; the tiny number keeps it finite there.
    """
    radial = transmural_gradient / ufl.sqrt(ufl.dot(transmural_gradient, transmural_gradient))
    horizontal = ufl.as_vector([-radial[1], radial[0], 0.0])
    circumferential = horizontal / ufl.sqrt(ufl.dot(horizontal, horizontal) + 1e-16)
    longitudinal = ufl.cross(radial, circumferential)
    return circumferential, radial, longitudinal


def fibre_directions(transmural, fibres: dict):
    """Fibre and sheet unit vectors: angles linear through the wall (UFL expressions).

    The helix angle turns the fibre from circumferential towards the base, the sheet angle turns
    the sheet from radial towards the in-wall normal of the fibre.
    """
    circumferential, radial, longitudinal = local_directions(ufl.grad(transmural))

    def angle(kind):
        endo, epi = (np.deg2rad(fibres[f"{kind}_{side}_deg"]) for side in ("endo", "epi"))
        return endo + (epi - endo) * transmural

    helix, tilt = angle("helix"), angle("sheet")
    fibre = ufl.cos(helix) * circumferential + ufl.sin(helix) * longitudinal
    across = ufl.cross(radial, fibre)
    sheet = ufl.cos(tilt) * radial + ufl.sin(tilt) * across
    return fibre, sheet


def _radial_direction(domain):
    x = ufl.SpatialCoordinate(domain)
    return ufl.as_vector([x[0], x[1], 0.0]) / ufl.sqrt(x[0] ** 2 + x[1] ** 2)


def _nodal_values(function, mesh: Mesh) -> np.ndarray:
    """Values of the mesh's transmural coordinate at a quadratic function's nodes."""
    nodes = function.function_space.tabulate_dof_coordinates()
    distance, nearest = cKDTree(mesh.points).query(nodes)
    if distance.max() > 1e-6:
        raise ValueError("mesh nodes and function nodes do not coincide")
    return mesh.transmural[nearest]
