"""A discrete equilibrium: residual, tangent, supports and the factorised linear system.

It knows neither heart nor material: `Simulator` is the left ventricle, the verification problems
are others.
"""

from dataclasses import dataclass

import numpy as np
import ufl
from petsc4py import PETSc

from regional_lv.mechanics import dolfinx_api as api


class LinearSolveError(ArithmeticError):
    """The tangent could not be factorised, or a field is no longer finite."""


@dataclass(frozen=True)
class Rotation:
    """Nodes whose x, y components are turned to r, theta: dofs `x`, `y` and `angle` (rad), (n,).

    Supports in cylindrical components are plain rows and columns of the turned system.
    """

    x: np.ndarray
    y: np.ndarray
    angle: np.ndarray


def deformation_gradient(u):
    """F = I + grad u."""
    return ufl.Identity(3) + ufl.grad(u)


def deformed_normal(F, domain):
    """The deformed surface's normal times its area per reference area (Nanson's formula)."""
    return ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(domain)


def virtual_work(energy, w, test, dx):
    """Internal virtual work (linear form) of an incompressible solid.

    `energy` is the strain energy density of the displacement in `w` = (u, p), p the multiplier of
    det F = 1.
    """
    u, p = ufl.split(w)
    return ufl.derivative((energy + p * (ufl.det(deformation_gradient(u)) - 1)) * dx, w, test)


def displacement_nodes(space) -> tuple[np.ndarray, np.ndarray]:
    """Displacement degrees of freedom (n, 3) of a u-p `space` and their coordinates (n, 3)."""
    dofs, coordinates = zip(
        *(api.tabulated_dofs(space.sub(0).sub(i)) for i in range(3)), strict=True
    )
    order = [np.lexsort(np.round(x, 6).T) for x in coordinates]
    dofs = np.stack([d[o] for d, o in zip(dofs, order, strict=True)], axis=1)
    return dofs, coordinates[0][order[0]]


class Equilibrium:
    """Equilibrium of the field `w` (u, p): residual(w; test) = 0, with `fixed` dofs held at zero.

    Parameters
    ----------
    w: function in a space of `dolfinx_api.mixed_space`.
    residual: linear form; tangent: its derivative.
    fixed: degrees of freedom that stay zero, after `rotation` (optional) of some nodes.
    """

    def __init__(self, w, residual, tangent, fixed: np.ndarray, rotation: Rotation | None = None):
        self.w = w
        self.size = len(w.x.array)
        self.fixed = np.unique(fixed)
        nobody = np.zeros(0, dtype=int)
        turned = rotation or Rotation(nobody, nobody, np.zeros(0))
        self._x, self._y = turned.x, turned.y
        self._cos, self._sin = np.cos(turned.angle), np.sin(turned.angle)
        self._residual = api.compile_form(residual)
        self._tangent = api.compile_form(tangent)
        self._build_linear_solver()

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

        # Positions of the entries that the rotation mixes: pairs of rows, then of columns.
        def entries(dof):
            first, last = indptr[dof], indptr[dof + 1]
            return first + np.argsort(indices[first:last], kind="stable")

        none = np.zeros(0, dtype=int)
        self._row_pairs = tuple(
            np.concatenate([none, *(entries(d) for d in dofs)]) for dofs in (self._x, self._y)
        )
        lengths = np.diff(indptr)[self._x]
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
        """Nodes to turn from x, y to r, theta (`sign` 1) or back (-1), in place."""
        x, y = vector[self._x].copy(), vector[self._y].copy()
        vector[self._x] = self._cos * x + sign * self._sin * y
        vector[self._y] = self._cos * y - sign * self._sin * x
        return vector

    def residual(self, w: np.ndarray) -> np.ndarray:
        """Residual (size,) in kPa mm^2, turned nodes in r, theta, supports zero."""
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
        """Turn rows and columns of the tangent's entries and put supports in, in place."""
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

