"""The left ventricle as a function of all its inputs: one program for every value of them.

`Problem.set` changes constants, fields and places of nodes; forms are compiled once. Supports of
the base are sizes, too. Each component of its displacement is on springs at the nodes with the
compliance c, of which s = c / (c + c0) is 0 where it is held and 1 where it is free:

    s f + (1 - s) k0 d = 0,        k0 = area / c0,

with the force f of the wall at a node, its displacement d, and the area that it stands for. With
s = 0 the displacement is prescribed, and the derivative with respect to s is known: d = -f / k0.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from regional_lv.aha import SEGMENTS
from regional_lv.geometry.directions import fibre_angles
from regional_lv.geometry.elements import (
    facet_nodes_of,
    facet_normal_changes,
    facet_normals,
    gauss,
    lagrange,
)
from regional_lv.geometry.mesh import BASE, Mesh
from regional_lv.geometry.shape import SHAPE_KEYS, NodePlaces
from regional_lv.geometry.thickness import thickened
from regional_lv.inputs.space import Inputs
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.mechanics.derivatives import ByCell, ByNode
from regional_lv.mechanics.equilibrium import Rotation
from regional_lv.mechanics.loads import LOADS, valve_plane_share, valve_plane_share_changes
from regional_lv.mechanics.observables.observer import Observer
from regional_lv.mechanics.simulator import Simulator, State
from regional_lv.mechanics.supports import COMPONENTS, Base, supports_from_config
from regional_lv.units import KPA_PER_MMHG

HALF_WAY = 1.0
"""c0, mm/kPa: about as compliant as the base itself."""


@dataclass(frozen=True)
class Linearised:
    """A solution and its derivatives with respect to the scaled coordinates of all inputs, k of
    them.

    fields (k, size) of the field; nodes, by input that moves them, of the unloaded nodes (n, 3);
    softening (k,) of the compressibility.
    """

    state: State
    fields: np.ndarray
    nodes: Mapping[int, np.ndarray]
    softening: np.ndarray


@dataclass(frozen=True)
class Perturbation:
    """Changes of what a problem is made of per unit of the scaled coordinates of k inputs.

    factors (k, factors, 17): logarithms of the law's factors; constants: of the forms, by name
    (k,); shares (k, 3) of the base's compliance; which (K,): inputs that move the unloaded nodes,
    by moves (K, n, 3) mm.
    """

    factors: np.ndarray
    constants: Mapping[str, np.ndarray]
    shares: np.ndarray
    which: np.ndarray
    moves: np.ndarray


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
        self.inputs = inputs.subset(each.is_simulated for each in inputs)
        model = self.inputs.base
        self._places = NodePlaces(mesh, model["geometry"])
        self.mesh = thickened(mesh, model["geometry"]["wall_thickness_scale"])
        self._share = np.zeros(3)
        self.model: Mapping = model
        super().__init__(self.mesh, model, extended=True)
        self._measure_base()

    # ------------------------------------------------------------------- forms and supports

    def _build_forms(self, *given):
        residual, tangent, terms = super()._build_forms(*given)
        self._forms = [residual, *(term.form for term in terms)]
        self._by_nodes: ByNode | None = None
        return residual, tangent, terms

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
        points, _ = gauss(2)
        normals = facet_normals(self._base_of(mesh), points)
        self._stiffness = self._to_nodes(np.linalg.norm(normals, axis=-1))[:, None] / HALF_WAY
        self._numbers["valves"].value = valve_plane_share(mesh)

    def _base_of(self, mesh: Mesh) -> Mesh:
        return replace(mesh, facets=mesh.facets[mesh.surface == BASE])

    def _to_nodes(self, density: np.ndarray) -> np.ndarray:
        """Integrals (..., b) over the base of a density (..., facets, q) at its Gauss points, times
        the shape functions of the base's nodes."""
        points, weights = gauss(2)
        each = density * weights @ lagrange(points, facet_nodes_of(self.mesh))[0]
        at = np.searchsorted(self._ring, self._base_of(self.mesh).facets)
        total = np.zeros((*density.shape[:-2], len(self._ring)))
        np.add.at(np.moveaxis(total, -1, 0), at, np.moveaxis(each, (-2, -1), (0, 1)))
        return total

    def _build_linear_solver(self) -> None:
        super()._build_linear_solver()
        indptr, indices = self._pattern
        rows = np.repeat(np.arange(self.size), np.diff(indptr))
        size = np.int64(self.size)
        keys = rows * size + indices
        order = np.argsort(keys)

        def entries(row, column):
            return order[np.searchsorted(keys, row * size + column, sorter=order)]

        of_base = np.zeros(self.size, dtype=bool)
        of_base[self._base_dofs] = True
        # What supports scale: rows and columns of the base. `solve` needs the columns as they were.
        self._scaled_entries = np.flatnonzero(of_base[rows] | of_base[indices])
        self._scaled_at = rows[self._scaled_entries], indices[self._scaled_entries]
        self._columns = np.flatnonzero(of_base[indices])
        starts = np.searchsorted(self._columns, indptr)
        self._columns_pattern = indices[self._columns], starts
        radial, around, _ = self._base_dofs.T
        self._mixed_entries = entries(radial, around), entries(around, radial)
        self._around_entries = entries(around, around)
        self._base_entries = entries(self._base_dofs, self._base_dofs)

    # ------------------------------------------------------------------------- values

    def set(self, theta: np.ndarray, pressure: float) -> None:
        """Set the inputs' values (k,) and the cavity pressure (mmHg), with which dead loads
        grow. Raises InputError as `apply` does."""
        self.apply(self.inputs.model(theta), pressure)

    def apply(self, model: Mapping, pressure: float) -> None:
        """Set everything that a model says, and the cavity pressure (mmHg).

        Raises InputError for a shape without a smooth wall; the problem is then unchanged.
        """
        moved = not _same(model["geometry"], self.model["geometry"])
        points = self._places(model["geometry"]) if moved else None
        self.model = model
        if points is not None:
            self.place_nodes(points)
        for name, function in self._factors.items():
            function.x.array[:] = model["factors"][name][self.segment]
        values = {**self._constants(model), "pressure_kpa": pressure * KPA_PER_MMHG}
        for name, value in values.items():
            self._numbers[name].value = value
        self._compressibility = values["compressibility"]
        self._share = _shares(model)

    def _constants(self, model: Mapping) -> dict[str, float]:
        """Values of the forms' constants that a model says, all but the pressure."""
        material, loading = model["material"], model["loading"]
        values = {**material["constants"], **material["reference"], **fibre_angles(model["fibres"])}
        values["compressibility"] = material["compressibility_per_kpa"]
        for support in supports_from_config(model["supports"]):
            if not isinstance(support, Base):
                values |= support.springs
        loads = (name for name in LOADS if name in loading)
        return values | {name: loading[name] / self.full_pressure for name in loads}

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
        return self._observer.with_settings(self.model["observables"])

    @observer.setter
    def observer(self, observer: Observer | None) -> None:
        self._observer = observer

    def tangents(self, state):
        return self.linearised(state).fields

    def differentiated(self, state, fraction):
        found = self.linearised(state)
        return *self.observed(found, fraction), found.fields

    def linearised(self, state: State) -> "Linearised":
        """Derivatives of the field with respect to all inputs, with the factor at hand.

        state: a solution, with which the last factorisation was made.
        """
        w = state.w
        self.set(state.theta, state.pressure)
        self._place(w)
        perturbation = self._perturbation(state.theta)
        changes = self._resisted(self._changes(perturbation))
        changes[:, self._base_dofs] += self._changes_at_base(w, perturbation)
        fields, moving = np.zeros_like(changes), changes.any(axis=1)
        if moving.any():
            fields[moving] = -self.solve(changes[moving])
        nodes = dict(zip(perturbation.which, perturbation.moves, strict=True))
        return Linearised(state, fields, nodes, perturbation.constants["compressibility"])

    def _perturbation(self, theta: np.ndarray) -> Perturbation:
        """What the inputs' scaled coordinates change of the numbers of the problem, at values
        theta."""
        model, k = self.model, len(self.inputs)
        factors, shares = np.zeros((k, len(self._factors), len(SEGMENTS))), np.zeros((k, 3))
        names = list(self._constants(model))
        numbers, shapes = np.zeros((k, len(names))), {}
        acting = [i for i, each in enumerate(self.inputs) if each.changes != "observables"]
        for i, beside in self.inputs.beside(theta, acting):
            section = self.inputs[i].changes
            if section == "geometry":
                shapes[i] = _slope(_shape_values, model, beside)
            elif section == "factors":
                factors[i] = _slope(self._logs, model, beside)
            else:
                shares[i] = _slope(_shares, model, beside)
                numbers[i] = _slope(
                    lambda model: np.array(list(self._constants(model).values())), model, beside
                )
        constants = dict(zip(names, numbers.T, strict=True)) | {"valves": np.zeros(k)}
        which, moves = np.array(list(shapes), dtype=int), np.zeros((0, *self.mesh.points.shape))
        if shapes:
            by_input = np.array(list(shapes.values()))
            about = {name for name, at in _shape_places(model).items() if by_input[:, at].any()}
            by_value = self._places.moves(model["geometry"], about).values()
            each = np.concatenate([move.reshape(-1, *moves.shape[1:]) for move in by_value])
            moves = np.tensordot(by_input, each, 1)
            constants["valves"][which] = valve_plane_share_changes(self.mesh, moves)
        return Perturbation(factors, constants, shares, which, moves)

    def _logs(self, model: Mapping) -> np.ndarray:
        """Logarithms (factors, 17) of the law's factors."""
        return np.log([model["factors"][name] for name in self._factors])

    def _changes(self, perturbation: Perturbation) -> np.ndarray:
        """Changes (k, size) of the residual in place, in x, y and nothing held."""
        changes = np.zeros((len(perturbation.factors), self.size))
        if perturbation.factors.any():
            which = np.flatnonzero(perturbation.factors.any(axis=(1, 2)))
            changes[which] += self._factor_forces(perturbation.factors[which][..., self.segment])
        constants = {name: each for name, each in perturbation.constants.items() if each.any()}
        if constants:
            changes += np.stack(list(constants.values()), axis=1) @ self._forces_of(constants)
        if len(perturbation.which):
            if self._by_nodes is None:
                order = api.element_order(self.mesh.cells)
                self._by_nodes = ByNode(self.domain, self._forms, self.mesh.points, order)
            acting = [0, *(1 + i for i, term in enumerate(self._terms) if term.acts)]
            changes[perturbation.which] += self._by_nodes.along(perturbation.moves, acting)
        return changes

    @cached_property
    def _by_constants(self) -> ByCell:
        return ByCell(
            self.domain, sum(self._forms[1:], self._forms[0]), list(self._numbers.values())
        )

    def _forces_of(self, names: Iterable[str]) -> np.ndarray:
        """Derivatives (m, size) of the residual in place with respect to m constants."""
        known = list(self._numbers)
        each = np.eye(len(known))[[known.index(name) for name in names], None]
        return self._by_constants.along(np.repeat(each, len(self.segment), axis=1))

    def _changes_at_base(self, w: np.ndarray, perturbation: Perturbation) -> np.ndarray:
        """Changes (k, b, 3) of the residual at the base's nodes under fixed forces: of the share of
        compliance, and of the nodes' places, with their coordinates and springs."""
        share, stiffness, stretch = self._share, self._stiffness, self._stretch
        forces, displacement = self._forces()[self._base_dofs], self._displacement_at_base(w)
        x, y, axial = forces.T
        radial, around = self._cos * x + self._sin * y, self._cos * y - self._sin * x
        turned = np.stack([radial, stretch * around, axial], axis=1)
        changes = perturbation.shares[:, None] * (turned - stiffness * displacement)
        if not len(perturbation.which):
            return changes
        # In polar coordinates, of the nodes in the unloaded and in the loaded state.
        move = perturbation.moves[:, self._ring]
        (radius, angle), (there, direction) = (self._radius, self._angle), self._polar(w)
        wider, turn = _polar_changes(move, radius, angle)
        wider_there, turn_there = _polar_changes(move, there, direction)
        stretching = (wider_there - stretch * wider) / radius
        of_forces = np.stack(
            [
                turn_there * around,
                stretching * around - stretch * turn_there * radial,
                np.zeros_like(turn),
            ],
            axis=-1,
        )
        of_displacement = np.stack(
            [
                wider_there - wider,
                wider * displacement[:, 1] / radius + radius * (turn_there - turn),
                np.zeros_like(turn),
            ],
            axis=-1,
        )
        base, (points, _) = self._base_of(self.mesh), gauss(2)
        normal = facet_normals(base, points)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        larger = np.einsum(
            "kfqx,fqx->kfq", facet_normal_changes(base, points, perturbation.moves), normal
        )
        stiffening = self._to_nodes(larger)[..., None] / HALF_WAY
        changes[perturbation.which] += share * of_forces
        changes[perturbation.which] += (1 - share) * (
            stiffening * displacement + stiffness * of_displacement
        )
        return changes

    def observed(
        self, found: "Linearised", fraction: float = 1.0, looking: Mapping | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values (d,) of the channels at a load, and derivatives (k, d) with respect to the inputs'
        scaled coordinates, of a solution of that load.

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
        own = [k for k, each in enumerate(self.inputs) if each.changes == "observables"]
        perturbed = {
            k: [
                (wall.with_settings({**other["observables"], **(looking or {})}), weight)
                for other, weight in beside
            ]
            for k, beside in self.inputs.beside(state.theta, own)
        }
        moves = self.displacement(found.fields)
        values, slopes = wall.with_settings(look).observe(
            channels, displacement, dilation, moves, dilation_moves, nodes, perturbed
        )
        assert slopes is not None
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
            vector[..., self._y] *= self._stretch
            return super()._rotate(vector, sign)
        vector = super()._rotate(vector)
        with np.errstate(invalid="ignore"):
            vector[..., self._y] *= self._stretch
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

    def _resisted(self, forces: np.ndarray) -> np.ndarray:
        """Forces (..., size) in the base's coordinates times the share of compliance, what pins it
        zero, in place."""
        forces = self._rotate(forces)
        # A step that went too far has infinite forces, and is shortened.
        with np.errstate(invalid="ignore"):
            forces[..., self._base_dofs] *= self._share
        if self._share[1] == 1:
            forces[..., self._y[0]] = 0.0
        return forces

    def residual(self, w: np.ndarray) -> np.ndarray:
        """Residual (size,): of the base's nodes as the module describes it."""
        residual = super().residual(w)
        springs = (1 - self._share) * self._stiffness
        residual[self._base_dofs] += springs * self._displacement_at_base(w)
        return residual

    def _support(self, data: np.ndarray) -> None:
        force = self._forces()
        x, y = force[self._x], force[self._y]
        radial, around = self._cos * x + self._sin * y, self._cos * y - self._sin * x
        # A node that moves around the axis turns its coordinates.
        for entries in self._mixed_entries:
            data[entries] += around / self._radius
        data[self._around_entries] -= self._stretch * radial / self._radius
        scale = np.ones(self.size)
        scale[self._base_dofs] = np.sqrt(self._share)
        if self._share[1] == 1:
            scale[self._y[0]] = 0.0
        self._plain = sparse.csr_matrix(
            (data[self._columns], *self._columns_pattern), (self.size, self.size)
        )
        rows, columns = self._scaled_at
        data[self._scaled_entries] *= scale[rows] * scale[columns]
        data[self._base_entries] += (1 - self._share) * self._stiffness
        if self._share[1] == 1:
            data[self._base_entries[0, 1]] = 1.0
        self._scale = scale
        self._inverse_scale = np.divide(1.0, scale, np.zeros(self.size), where=scale != 0)

    def solve(self, vectors: np.ndarray) -> np.ndarray:
        """Solve with the last factorised tangent for vectors (..., size) as `residual` gives."""
        scale, right = self._scale, vectors.copy()
        known = np.zeros_like(vectors)
        of_base = scale[self._base_dofs] == 0
        known[..., self._base_dofs] = of_base * vectors[..., self._base_dofs] / self._stiffness
        if self._share[1] == 1:
            known[..., self._y[0]] = 0.0
        if known.any():
            right -= (self._plain @ known.T).T * scale**2
        right *= self._inverse_scale
        found = self._back_substituted(right) * scale + known
        return self._rotate(found, -1.0)


def _slope(number: Callable, model: Mapping, beside) -> np.ndarray:
    """Derivative of what `number` says of a model, from models beside it with weights."""
    here = number(model)
    return sum(weight * (number(other) - here) for other, weight in beside)


def _shape_values(model: Mapping) -> np.ndarray:
    """Numbers of the shape, one after the other, as `NodePlaces.moves` has them."""
    shape = model["geometry"]
    return np.concatenate([np.ravel(shape[name]) for name in _shape_places(model)])


def _shape_places(model: Mapping) -> dict[str, slice]:
    """Where `_shape_values` has each key of the shape."""
    shape, places, first = model["geometry"], {}, 0
    for name in ("wall_thickness_scale", *SHAPE_KEYS):
        if name in shape:
            places[name] = slice(first, first + np.size(shape[name]))
            first = places[name].stop
    return places


def _polar_changes(move: np.ndarray, radius: np.ndarray, angle: np.ndarray):
    """Changes (K, b) of radius and angle (b,) of nodes under moves (K, b, 3)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * move[..., 0] + sin * move[..., 1], (
        cos * move[..., 1] - sin * move[..., 0]
    ) / radius


def _shares(model: Mapping) -> np.ndarray:
    """c / (c + c0) of the base's compliances (mm/kPa) that a model says, (3,)."""
    base = model["supports"]["base"]
    return np.array([_share(base[component]) for component in COMPONENTS])


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
