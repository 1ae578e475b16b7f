"""The left ventricle as a function of all its inputs: one program for every value of them.

`Problem.set` changes constants, fields and places of nodes; forms are compiled once. Supports of
the base are sizes, too. Each component of its displacement is on springs at the nodes with the
compliance c, of which s = c / (c + c0) is 0 where it is held and 1 where it is free:

    s f + (1 - s) k0 d = 0,        k0 = area / c0,

with the force f of the wall at a node, its displacement d, and the area that it stands for. With
s = 0 the displacement is prescribed, and the derivative about s is known: d = -f / k0.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse

from regional_lv.geometry.elements import facet_nodes_of, facet_normals, gauss, lagrange
from regional_lv.geometry.mesh import BASE, Mesh
from regional_lv.geometry.shape import NodePlaces
from regional_lv.geometry.thickness import thickened
from regional_lv.inputs.space import Inputs
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.mechanics.equilibrium import LinearSolveError, Rotation
from regional_lv.mechanics.fibres import fibre_angles
from regional_lv.mechanics.loads import LOADS, valve_plane_share
from regional_lv.mechanics.observables.observer import Observer
from regional_lv.mechanics.simulator import Simulator, State
from regional_lv.mechanics.supports import COMPONENTS, Base, supports_from_config
from regional_lv.units import KPA_PER_MMHG

HALF_WAY = 1.0
"""c0, mm/kPa: about as compliant as the base itself."""


NODE_STEP = 1e-4
"""mm, by which the nodes are moved to either side to differentiate the residual."""


@dataclass(frozen=True)
class Linearised:
    """A solution and its derivatives about the scaled coordinates of all inputs, k of them.

    fields (k, size) of the field; nodes, by input that moves them, of the unloaded nodes (n, 3);
    softening (k,) of the compressibility.
    """

    state: State
    fields: np.ndarray
    nodes: Mapping[int, np.ndarray]
    softening: np.ndarray


class Problem(Simulator):
    """Equilibrium for any values of the inputs; `theta` of a `State` are these values, x (k,).

    Attributes: inputs, the simulated ones.

    Parameters
    ----------
    mesh: geometry with segments, surfaces and the transmural coordinate (mm), its wall not scaled.
    inputs: those of a study; closed forms among them are left out.
    """

    _observer: Observer | None

    def __init__(self, mesh: Mesh, inputs: Inputs):
        self.inputs = inputs.simulated
        model = self.inputs.base
        self._places = NodePlaces(mesh, model["geometry"])
        self.mesh = thickened(mesh, model["geometry"]["wall_thickness_scale"])
        self._share = np.zeros(3)
        self.model: Mapping = model
        super().__init__(self.mesh, model, extended=True)
        self._measure_base()

    # ------------------------------------------------------------------- forms and supports

    def _parts(self):
        return self.segment, tuple(self.material.references)

    def _potentials(self, surroundings, supports, loads, valves):
        others = [support for support in supports if not isinstance(support, Base)]
        yield from super()._potentials(surroundings, others, loads, valves)

    def _held(self, mesh: Mesh, base: Base | None):
        self._ring = mesh.nodes_on(BASE)
        self._base_dofs = self._node_dofs[self._ring]
        x, y, _ = mesh.points[self._ring].T
        radial, around, _ = self._base_dofs.T
        return np.zeros(0, dtype=int), Rotation(radial, around, np.arctan2(y, x))

    def _measure_base(self) -> None:
        """Radius, angle and area of the base's nodes, and the load on the valves, as the nodes
        are."""
        mesh = self.mesh
        x, y, _ = mesh.points[self._ring].T
        self._radius, self._angle = np.hypot(x, y), np.arctan2(y, x)
        points, weights = gauss(2)
        base = replace(mesh, facets=mesh.facets[mesh.surface == BASE])
        normal = np.linalg.norm(facet_normals(base, points), axis=-1)
        area = np.zeros(len(mesh.points))
        each = normal * weights @ lagrange(points, facet_nodes_of(mesh))[0]
        np.add.at(area, base.facets, each)
        self._stiffness = area[self._ring, None] / HALF_WAY
        self._numbers["valves"].value = valve_plane_share(mesh)

    def _build_linear_solver(self) -> None:
        super()._build_linear_solver()
        indptr, indices = self._pattern
        rows = np.repeat(np.arange(self.size), np.diff(indptr))
        size = np.int64(self.size)
        keys = rows * size + indices
        order = np.argsort(keys)

        def entries(row, column):
            return order[np.searchsorted(keys, row * size + column, sorter=order)]

        radial, around, _ = self._base_dofs.T
        self._mixed_entries = entries(radial, around), entries(around, radial)
        self._around_entries = entries(around, around)
        self._base_entries = entries(self._base_dofs, self._base_dofs)
        self._rows = rows

    # ------------------------------------------------------------------------- values

    def set(self, theta: np.ndarray, pressure: float) -> None:
        """Set the inputs' values (k,) and the cavity pressure (mmHg), with which dead loads
        grow."""
        self.apply(self.inputs.model(theta), pressure)

    def apply(self, model: Mapping, pressure: float) -> None:
        """Set everything that a model says, and the cavity pressure (mmHg)."""
        before, self.model = self.model, model
        if not _same(model["geometry"], before["geometry"]):
            self.place_nodes(self._places(model["geometry"]))
        for name, function in self._factors.items():
            function.x.array[:] = model["factors"][name][self.segment]
        material, loading = model["material"], model["loading"]
        self._compressibility = material["compressibility_per_kpa"]
        values = {**material["constants"], **material["reference"], **fibre_angles(model["fibres"])}
        values["compressibility"] = self._compressibility
        for support in supports_from_config(model["supports"]):
            if not isinstance(support, Base):
                values |= support.springs
        values |= {name: loading[name] / self.full_pressure for name in LOADS if name in loading}
        values["pressure_kpa"] = pressure * KPA_PER_MMHG
        for name, value in values.items():
            self._numbers[name].value = value
        base = model["supports"]["base"]
        self._share = np.array([_share(base[component]) for component in COMPONENTS])

    @property
    def coordinates(self):
        return self.inputs.coordinates

    @property
    def middle(self):
        return self.inputs.nominal

    @property
    def reference(self):
        return self.inputs.reference

    def stiffer(self, theta, factor):
        # Dead loads are shares of the cavity's pressure, which stays.
        powers = [0 if each.changes == "loading" else each.stress_power for each in self.inputs]
        return theta * float(factor) ** np.array(powers, dtype=float)

    def factorise(self, w: np.ndarray) -> None:
        # A base in its plane leaves the tangent symmetric (`Simulator`).
        symmetric = bool(self._share[2] == 0) and api.element_order(self.mesh.cells) == 2
        if symmetric != self._symmetric:
            self._symmetric = symmetric
            if self._matrix is not None:
                self._reset_solver()
        super().factorise(w)

    def place_nodes(self, points: np.ndarray) -> None:
        """Move the unloaded nodes to points (n, 3) mm."""
        self.mesh = replace(self.mesh, points=points)
        api.move_nodes(self.domain, points)
        self._measure_base()
        self._observer = None

    # ------------------------------------------------------------------- what is observed

    @property
    def observer(self) -> Observer:
        """Of the wall as its nodes are, made when it is asked for; it looks as the model says."""
        if self._observer is None:
            self._observer = Observer(self.mesh, self.model["observables"])
            self._wall_volume = self._observer.wall.volume.sum()
        return self._observer.looking(self.model["observables"])

    @observer.setter
    def observer(self, observer: Observer | None) -> None:
        self._observer = observer

    def tangents(self, state):
        return self.linearised(state).fields

    def differentiated(self, state, fraction):
        found = self.linearised(state)
        return *self.observed(found, fraction), found.fields

    def linearised(self, state: State) -> "Linearised":
        """Derivatives of the field about all inputs, with the factor at hand.

        state: a solution, with which the last factorisation was made.
        """
        w, inputs = state.w, self.inputs
        self.set(state.theta, state.pressure)
        model, points = self.model, self.mesh.points
        self._place(w)
        of_parts = moves = None
        changes = np.zeros((len(inputs), self.size))
        nodes: dict[int, Any] = {}
        softening = np.zeros(len(inputs))
        for k, each in enumerate(inputs):
            if each.changes == "observables":
                continue
            beside = list(inputs.beside(state.theta, k))
            if each.changes == "factors":
                # Exact, and on the cells of each segment alone.
                if of_parts is None:
                    of_parts = np.stack([self._assembled(form) for form in self._parameter_forms])
                slopes = sum(
                    weight * np.log(np.stack([other["factors"][name] for name in self._factors]))
                    for other, weight in beside
                )
                changes[k] = slopes.T.ravel() @ of_parts
            elif each.changes == "geometry":
                moves = moves or self._places.moves(model["geometry"])
                nodes[k] = sum(
                    np.tensordot(
                        sum(weight * other["geometry"][key] for other, weight in beside),
                        move,
                        np.ndim(model["geometry"][key]),
                    )
                    for key, move in moves.items()
                )
                step = NODE_STEP / np.abs(nodes[k]).max()
                for sign in (1, -1):
                    self.place_nodes(points + sign * step * nodes[k])
                    changes[k] += sign / (2 * step) * self.residual(w)
                self.place_nodes(points)
            else:
                for other, weight in beside:
                    self.apply(other, state.pressure)
                    changes[k] += weight * self.residual(w)
                self.apply(model, state.pressure)
                softening[k] = sum(
                    weight * other["material"]["compressibility_per_kpa"]
                    for other, weight in beside
                )
        self._place(w)
        fields = np.stack([-self.solve(change) if change.any() else change for change in changes])
        return Linearised(state, fields, nodes, softening)

    def observed(
        self, found: "Linearised", fraction: float = 1.0, looking: Mapping | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values (d,) of the channels at a load, and derivatives (k, d) about the inputs' scaled
        coordinates, of a solution of that load.

        looking: keys of the section `observables` that differ from the state's (layer, measure,
        rotation of the segments): a solution is observed many times at no further solve.
        """
        state, channels = found.state, self._channels_at[fraction][1]
        self.set(state.theta, state.pressure)
        w, wall = state.w, self.observer
        look = {**self.model["observables"], **(looking or {})}
        displacement, dilation = self.displacement(w), self.wall_dilation(w)
        dilation_moves = self._compressibility * found.fields[:, self._pressure_at]
        dilation_moves += found.softening[:, None, None] * w[self._pressure_at]
        nodes = None
        if found.nodes:
            nodes = np.zeros((len(self.inputs), *self.mesh.points.shape))
            for k, move in found.nodes.items():
                nodes[k] = move
        moves = self.displacement(found.fields)
        values, slopes = wall.looking(look).observe(
            channels, displacement, dilation, moves, dilation_moves, nodes
        )
        assert slopes is not None
        for k, each in enumerate(self.inputs):
            if each.changes == "observables":
                slopes[k] = sum(
                    weight
                    * wall.looking({**other["observables"], **(looking or {})}).values(
                        channels, displacement, dilation
                    )
                    for other, weight in self.inputs.beside(state.theta, k)
                )
        return values, slopes

    # -------------------------------------------------- equilibrium in the base's coordinates
    #
    # Nodes of the base have the coordinates r, R theta and z, in which springs and what holds them
    # are linear; R is their unloaded radius.

    def _place(self, w: np.ndarray) -> None:
        self.w.x.array[:] = w
        radius, angle = self._polar(w)
        self._turn(angle, radius / self._radius)

    def _polar(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Radius and angle of the base's nodes under a field."""
        x = self._radius * np.cos(self._angle) + w[self._x]
        y = self._radius * np.sin(self._angle) + w[self._y]
        return np.hypot(x, y), np.arctan2(y, x)

    def _displacement_at_base(self, w: np.ndarray) -> np.ndarray:
        """Displacement (b, 3) mm of the base's nodes in their coordinates."""
        radius, angle = self._polar(w)
        turned = np.angle(np.exp(1j * (angle - self._angle)))
        return np.stack(
            [radius - self._radius, self._radius * turned, w[self._base_dofs[:, 2]]], axis=1
        )

    def _rotate(self, vector: np.ndarray, sign: float = 1.0) -> np.ndarray:
        """Forces to the base's coordinates (`sign` 1), or displacements back (-1), in place."""
        if sign < 0:
            vector[self._y] *= self._stretch
            return super()._rotate(vector, sign)
        vector = super()._rotate(vector)
        with np.errstate(invalid="ignore"):
            vector[self._y] *= self._stretch
        return vector

    def retract(self, w: np.ndarray) -> np.ndarray:
        """The field `w` with held nodes of the base in their places, as a copy.

        Where nothing resists a rotation about the axis, the field is turned as a whole so that the
        base's mean rotation is none: equilibrium leaves that open.
        """
        w = w.copy()
        radius, angle = self._polar(w)
        turned = np.angle(np.exp(1j * (angle - self._angle)))
        if self._share[1] == 1:
            weight = self._stiffness[:, 0] * self._radius**2
            w = self._turned(w, -(weight @ turned) / weight.sum())
            radius, angle = self._polar(w)
        elif self._share[1] == 0:
            angle = self._angle
        if self._share[0] == 0:
            radius = self._radius
        w[self._x] = radius * np.cos(angle) - self._radius * np.cos(self._angle)
        w[self._y] = radius * np.sin(angle) - self._radius * np.sin(self._angle)
        if self._share[2] == 0:
            w[self._base_dofs[:, 2]] = 0.0
        return w

    def _turned(self, w: np.ndarray, angle: float) -> np.ndarray:
        """The field of the deformed ventricle turned about the long axis by an angle (rad)."""
        if not np.isfinite(angle):
            return w
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        points, w = self.mesh.points, w.copy()
        w[self._node_dofs] = (points + w[self._node_dofs]) @ turn.T - points
        return w

    def supported(self, w: np.ndarray) -> np.ndarray:
        return self.retract(w)

    def _scaled_by_share(self, vector: np.ndarray) -> np.ndarray:
        """Forces at the base's nodes times the share of compliance, what pins it zero, in place."""
        vector[self._base_dofs] *= self._share
        if self._share[1] == 1:
            vector[self._y[0]] = 0.0
        return vector

    def _assembled(self, form) -> np.ndarray:
        vector = self._rotate(api.assemble_vector(np.zeros(self.size), form))
        return self._scaled_by_share(vector)

    def residual(self, w: np.ndarray) -> np.ndarray:
        """Residual (size,): of the base's nodes as the module describes it."""
        residual = super().residual(w)
        springs = (1 - self._share) * self._stiffness
        residual[self._base_dofs] += springs * self._displacement_at_base(w)
        return residual

    def _support(self, data: np.ndarray) -> None:
        force = api.assemble_vector(np.zeros(self.size), self._residual)
        x, y = force[self._x], force[self._y]
        radial, around = self._cos * x + self._sin * y, self._cos * y - self._sin * x
        # A node that moves around the axis turns its coordinates.
        for entries in self._mixed_entries:
            data[entries] += around / self._radius
        data[self._around_entries] -= self._stretch * radial / self._radius
        _, indices = self._pattern
        scale = np.ones(self.size)
        scale[self._base_dofs] = np.sqrt(self._share)
        if self._share[1] == 1:
            scale[self._y[0]] = 0.0
        self._plain = data.copy()
        data *= scale[self._rows] * scale[indices]
        data[self._base_entries] += (1 - self._share) * self._stiffness
        if self._share[1] == 1:
            data[self._base_entries[0, 1]] = 1.0
        self._scale = scale
        self._prescribed = np.flatnonzero(scale == 0)

    def solve(self, vector: np.ndarray) -> np.ndarray:
        """Solve with the last factorised tangent; `vector` as `residual` gives it."""
        prescribed, scale = self._prescribed, self._scale
        known = np.zeros(self.size)
        known[self._base_dofs] = vector[self._base_dofs] / self._stiffness
        if self._share[1] == 1:
            known[self._y[0]] = 0.0
        known[scale != 0] = 0.0
        right = vector.copy()
        if known.any():
            indptr, indices = self._pattern
            right -= sparse.csr_matrix((self._plain, indices, indptr)) @ known * scale**2
        right[prescribed] = 0.0
        right[scale != 0] /= scale[scale != 0]
        self._rhs.setArray(right)
        self._ksp.solve(self._rhs, self._solution)
        solution = self._solution.getArray() * scale + known
        if not np.isfinite(solution).all():
            self._reset_solver()
            raise LinearSolveError("the Newton step is not finite")
        return self._rotate(solution, -1.0)


def _share(compliance: float) -> float:
    """c / (c + c0) of a compliance c (mm/kPa)."""
    return 1.0 if math.isinf(compliance) else compliance / (compliance + HALF_WAY)


def _same(one: Mapping, other: Mapping) -> bool:
    """Whether two sections hold the same values."""
    return one is other or all(
        one[key] is other[key] or np.array_equal(one[key], other[key])
        for key in one
        if key != "table"
    )
