"""A discrete equilibrium: residual, tangent, supports and the factorised linear system.

It knows neither heart nor material: `Simulator` is the left ventricle, the verification problems
are others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import ufl
from ufl.algorithms import expand_derivatives

from regional_lv.mechanics import dolfinx_api as api


class LinearSolveError(ArithmeticError):
    """The tangent could not be factorised, or a field is no longer finite."""


@dataclass(frozen=True)
class Rotation:
    """Nodes whose x, y components are turned to r, theta: dofs `x`, `y` and `angle` (rad), (n,).

    Supports in cylindrical components are plain rows and columns of the turned system. With
    `circle` (n, 2), their x, y in the reference state, the nodes stay on their circles about the
    axis and r, theta turn with them: held along the first direction alone they would slide along
    the tangents and widen the ring.
    """

    x: np.ndarray
    y: np.ndarray
    angle: np.ndarray
    circle: np.ndarray | None = None


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


class Term:
    """A part of a residual that is nothing where all its numbers are zero: it is compiled when it
    first acts, and assembled only while it does.

    numbers: constants of the form. residual: linear form of the field w, in the space of `trial`.
    """

    def __init__(self, numbers: Sequence, residual, w, trial):
        self._numbers, self.form = numbers, residual
        self._w, self._trial = w, trial

    @property
    def acts(self) -> bool:
        return any(number.value != 0 for number in self._numbers)

    @cached_property
    def residual(self):
        return api.compile_form(self.form)

    @cached_property
    def tangents(self) -> tuple:
        """Its compiled derivative; none of a dead load along a direction that stays."""
        slope = expand_derivatives(ufl.derivative(self.form, self._w, self._trial))
        return () if slope.empty() else (api.compile_form(slope),)


class Equilibrium:
    """Equilibrium of the field `w` (u, p): residual(w; test) = 0, with `fixed` dofs held at zero.

    Parameters
    ----------
    w: function in a space of `dolfinx_api.mixed_space`.
    residual: linear form; tangent: its derivative.
    fixed: degrees of freedom that stay zero, after `rotation` (optional) of some nodes.
    symmetric: whether the tangent is; a symmetric factorisation takes half the operations.
    terms: further parts of the residual, with their tangents.
    """

    displacement_dofs: np.ndarray

    def __init__(
        self,
        w,
        residual,
        tangent,
        fixed: np.ndarray,
        rotation: Rotation | None = None,
        symmetric: bool = False,
        terms: Sequence[Term] = (),
    ):
        self.w = w
        self.size = len(w.x.array)
        self.fixed = np.unique(fixed)
        self._symmetric = symmetric
        self._terms = terms
        nobody = np.zeros(0, dtype=int)
        turned = rotation or Rotation(nobody, nobody, np.zeros(0))
        self._x, self._y, self._circle = turned.x, turned.y, turned.circle
        self._residual = api.compile_form(residual)
        self._tangent = api.compile_form(tangent)
        self._ksp: Any = None
        self._petsc_matrix: Any = None
        self._matrix: Any = None  # built when it is first needed: it takes most of the memory
        self._turn(turned.angle)

    def set(self, theta: np.ndarray, pressure: float) -> None:
        """Set the parameters (P,) and the pressure: of a subclass that `Solver` is for, which has
        the `displacement_dofs` (n, 3) as well."""
        raise NotImplementedError

    def _build_linear_solver(self) -> None:
        self._matrix = api.Matrix(self._tangent)
        indptr = self._matrix.indptr.astype(np.int32)
        indices = self._matrix.indices.astype(np.int32)
        self._data = self._matrix.data
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
        self._row_node = np.repeat(np.arange(len(self._x)), np.diff(indptr)[self._x])

        place = np.full(self.size, -1)
        place[self._x] = place[self._y] = np.arange(len(self._x))
        column_x = np.flatnonzero(np.isin(indices, self._x))
        column_y = np.flatnonzero(np.isin(indices, self._y))
        key_x = np.lexsort((place[indices[column_x]], rows[column_x]))
        key_y = np.lexsort((place[indices[column_y]], rows[column_y]))
        self._column_pairs = column_x[key_x], column_y[key_y]
        self._column_node = place[indices[self._column_pairs[0]]]
        diagonal = np.flatnonzero(rows == indices)
        self._around_diagonal = diagonal[self._y]

        self._pattern = indptr, indices
        self._reset_solver()

    def _reset_solver(self) -> None:
        """Build matrix and factorisation anew: after NaN, the old ones no longer work."""
        if self._ksp is not None:
            # PETSc keeps what Python drops until it is asked.
            self._ksp.destroy()
            self._petsc_matrix.destroy()
        self._petsc_matrix = api.PETSc.Mat().createAIJWithArrays(
            (self.size, self.size), (*self._pattern, self._data), comm=api.PETSc.COMM_SELF
        )
        self._ksp = api.PETSc.KSP().create(api.PETSc.COMM_SELF)
        self._ksp.setOperators(self._petsc_matrix)
        self._ksp.setType("preonly")
        self._petsc_matrix.setOption(api.PETSc.Mat.Option.SYMMETRIC, self._symmetric)
        self._ksp.getPC().setType("cholesky" if self._symmetric else "lu")
        self._ksp.getPC().setFactorSolverType("mumps")
        self._ksp.setErrorIfNotConverged(False)
        self._rhs, self._solution = self._petsc_matrix.createVecs()

    def _turn(self, angle: np.ndarray, stretch: np.ndarray | None = None) -> None:
        """Take new angles of the turned nodes. stretch: how far one moves per unit of its second
        coordinate, 1 by default."""
        self._cos, self._sin = np.cos(angle), np.sin(angle)
        self._stretch = np.ones_like(angle) if stretch is None else stretch

    def _place(self, w: np.ndarray) -> None:
        """Take `w` as the field; nodes on circles take their r, theta along."""
        self.w.x.array[:] = w
        if self._circle is not None:
            x, y = self._circle[:, 0] + w[self._x], self._circle[:, 1] + w[self._y]
            self._turn(np.arctan2(y, x))

    def retract(self, w: np.ndarray) -> np.ndarray:
        """The field `w` with nodes that stay on circles moved back there, as a copy."""
        w = w.copy()
        if self._circle is not None:
            place = self._circle + np.stack([w[self._x], w[self._y]], axis=1)
            place *= np.linalg.norm(self._circle, axis=1, keepdims=True) / np.linalg.norm(
                place, axis=1, keepdims=True
            )
            w[self._x], w[self._y] = (place - self._circle).T
        return w

    def _rotate(self, vector: np.ndarray, sign: float = 1.0) -> np.ndarray:
        """Nodes to turn from x, y to r, theta (`sign` 1) or back (-1), in place; of a vector or
        of vectors (..., size)."""
        x, y = vector[..., self._x], vector[..., self._y]
        # Residuals of a step that went astray may be infinite; whoever took it looks at their norm.
        with np.errstate(invalid="ignore"):
            vector[..., self._x] = self._cos * x + sign * self._sin * y
            vector[..., self._y] = self._cos * y - sign * self._sin * x
        return vector

    def supported(self, w: np.ndarray) -> np.ndarray:
        """The field `w` with the held degrees of freedom at zero, as a copy."""
        held = self._rotate(w.copy())
        held[self.fixed] = 0.0
        return self._rotate(held, -1.0)

    def _acting(self) -> list[Term]:
        return [term for term in self._terms if term.acts]

    def _forces(self) -> np.ndarray:
        """Residual (size,) of the field in place, in x, y, nothing held."""
        forms = [self._residual, *(term.residual for term in self._acting())]
        return api.assemble_vector(np.zeros(self.size), *forms)

    def _resisted(self, forces: np.ndarray) -> np.ndarray:
        """Forces (..., size) with turned nodes in r, theta, and none on what is held, in place."""
        forces = self._rotate(forces)
        forces[..., self.fixed] = 0.0
        return forces

    def residual(self, w: np.ndarray) -> np.ndarray:
        """Residual (size,) in kPa mm^2, turned nodes in r, theta, supports zero."""
        self._place(w)
        return self._resisted(self._forces())

    def factorise(self, w: np.ndarray) -> None:
        """Assemble and factorise the tangent at `w`; `solve` then uses it."""
        self.assemble(w)
        self._petsc_matrix.assemble()
        self._ksp.setOperators(self._petsc_matrix)
        try:
            self._ksp.getPC().setUp()
        except api.PETSc.Error as error:
            self._reset_solver()
            raise LinearSolveError("the tangent could not be factorised") from error

    def assemble(self, w: np.ndarray) -> None:
        """Assemble the tangent at `w`, nodes turned and supports in place."""
        if self._matrix is None:
            self._build_linear_solver()
        self._place(w)
        data = self._data
        further = [tangent for term in self._acting() for tangent in term.tangents]
        self._matrix.assemble(self._tangent, *further)
        if not np.isfinite(data).all():
            raise LinearSolveError("the tangent is not finite")
        for (a, b), node in (
            (self._row_pairs, self._row_node),
            (self._column_pairs, self._column_node),
        ):
            cos, sin, x, y = self._cos[node], self._sin[node], data[a], data[b]
            data[a], data[b] = cos * x + sin * y, self._stretch[node] * (cos * y - sin * x)
        self._support(data)

    def _support(self, data: np.ndarray) -> None:
        """Put the supports into the entries of the turned tangent, in place."""
        if self._circle is not None:
            # A node that moves on turns the force that its circle takes up.
            force = self._rotate(self._forces())
            data[self._around_diagonal] -= force[self._x] / np.linalg.norm(self._circle, axis=1)
        data[self._fixed_entries] = 0.0
        data[self._fixed_diagonal] = 1.0

    def solve(self, vectors: np.ndarray) -> np.ndarray:
        """Solve with the last factorised tangent for vectors (..., size) as `residual` gives."""
        return self._rotate(self._back_substituted(vectors), -1.0)

    def _back_substituted(self, vectors: np.ndarray) -> np.ndarray:
        """Solutions (..., size) of the factorised system; together they cost much less than one by
        one."""
        try:
            if vectors.ndim == 1:
                self._rhs.setArray(vectors)
                self._ksp.solve(self._rhs, self._solution)
                found = self._solution.getArray().copy()
            else:
                found = api.solve_many(self._ksp, vectors)
        except api.PETSc.Error as error:
            self._reset_solver()
            raise LinearSolveError("the factorised tangent could not be solved with") from error
        if not np.isfinite(found).all():
            self._reset_solver()
            raise LinearSolveError("the Newton step is not finite")
        return found
