"""Derivatives of a residual with respect to numbers of the cells and to places of the nodes.

Each is one bilinear form, integrated once at a solution, and every direction is a product with what
cells contribute: many inputs cost as many integrals as a few.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import ufl
from scipy.spatial import cKDTree

from regional_lv.mechanics import dolfinx_api as api


class _Derivative:
    """The derivative of linear forms as bilinear ones, compiled when they are first asked for.

    forms: UFL. space: of their trial function.
    """

    def __init__(self, forms: Sequence, space):
        self._forms = forms
        self._columns = api.dimension(space)
        self._compiled: dict[int, Any] = {}

    def _form(self, which: int):
        if which not in self._compiled:
            self._compiled[which] = api.compile_form(self._forms[which])
        return self._compiled[which]

    def _along(self, dofs: np.ndarray, directions: np.ndarray, which=(0,)) -> np.ndarray:
        """Changes (K, size) of the sum of some forms along `directions` (K, ...) of the degrees of
        freedom `dofs` (...)."""
        columns = np.zeros((self._columns, len(directions)))
        columns[dofs.ravel()] = directions.reshape(len(directions), dofs.size).T
        return api.product(columns, *(self._form(number) for number in which)).T


class ByCell(_Derivative):
    """The derivative of a linear form with respect to numbers that may differ from cell to cell.

    form: UFL. numbers: P constants or cellwise functions in it, in UFL's classes of dolfinx.
    """

    def __init__(self, domain, form, numbers: Sequence):
        space = api.columns_space(domain, "DG", 0, len(numbers))
        varied = api.fem.Function(space)
        own = {number: varied[i] for i, number in enumerate(numbers)}
        slope = ufl.derivative(ufl.replace(form, own), varied, ufl.TrialFunction(space))
        super().__init__([ufl.replace(slope, {varied: ufl.as_vector(list(numbers))})], space)
        self._dofs = api.cellwise_dofs(space, len(numbers))

    def along(self, directions: np.ndarray) -> np.ndarray:
        """Changes (K, size) of the form along directions (K, cells, P) of the numbers."""
        return self._along(self._dofs, directions)


class ByNode(_Derivative):
    """The derivative of linear forms with respect to the places of the mesh's nodes, in which
    functions keep their values (UFL's coordinate derivative; Ham et al. 2019,
    doi 10.1007/s00158-019-02281-z).

    forms: UFL. points (n, 3) mm: the nodes as they are when it is made. order: of the elements.
    """

    def __init__(self, domain, forms: Sequence, points: np.ndarray, order: int):
        space = api.columns_space(domain, "Lagrange", order, 3)
        place, move = ufl.SpatialCoordinate(domain), ufl.TrialFunction(space)
        super().__init__([ufl.derivative(form, place, move) for form in forms], space)
        dofs = []
        for i in range(3):
            own, coordinates = api.tabulated_dofs(space.sub(i))
            dofs.append(own[cKDTree(coordinates).query(points)[1]])
        self._dofs = np.stack(dofs, axis=1)

    def along(self, moves: np.ndarray, which: Sequence[int]) -> np.ndarray:
        """Changes (K, size) of the sum of some forms per unit of moves (K, n, 3) of the nodes."""
        return self._along(self._dofs, moves, which)
