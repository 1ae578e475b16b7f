"""The left ventricle's inflation as a finite element problem: residual, tangent, observables.

Hexahedra for displacement and pressure (u-p, incompressible), quadratic with linear pressure or
linear with piecewise constant pressure as the mesh is; follower pressure on the endocardium. It is
made of objects: a material law, supports, loads, stiffness inputs, and an observer. This module
knows one equilibrium problem; how a solution is reached is the business of `continuation`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from scipy.spatial import cKDTree

from regional_lv.aha import SEGMENTS
from regional_lv.channels import Channels
from regional_lv.geometry.mesh import BASE, Mesh
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.model import segment_factors
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.mechanics.derivatives import ByCell
from regional_lv.mechanics.equilibrium import (
    Equilibrium,
    Term,
    deformation_gradient,
    displacement_nodes,
    virtual_work,
)
from regional_lv.mechanics.fibres import fibre_directions
from regional_lv.mechanics.loads import (
    LOADS,
    cavity_work,
    valve_plane_potential,
    valve_plane_share,
)
from regional_lv.mechanics.materials import material_from_config
from regional_lv.mechanics.observables.observer import Observer
from regional_lv.mechanics.supports import Base, Surroundings, supports_from_config
from regional_lv.units import KPA_PER_MMHG

QUADRATURE_DEGREE = 5  # three Gauss points per direction
FLAT_MM = 1e-6  # range of the heights of a base that is perpendicular to the axis


@dataclass(frozen=True)
class State:
    """A solution: degrees of freedom `w`, parameters `theta` (P,) and `pressure` (mmHg)."""

    w: np.ndarray
    theta: np.ndarray
    pressure: float


class Simulator(Equilibrium):
    """Equilibrium of one left ventricle for any theta and pressure.

    Attributes: `parameters` (StiffnessInputs), `channels` (Channels) that are observed,
    `full_pressure` (mmHg) to which load fractions refer.

    Parameters
    ----------
    mesh: geometry with segments, surfaces and the transmural coordinate (mm).
    physics: sections `material`, `fibres`, `loading`, `supports`, `observables` of the
        configuration, and `parameters`, the `spec` of the stiffness inputs. `fibres` may have
        `segment_helix_deg`, what single AHA segments add to the helix angle.
    extended: whether all optional terms (springs, dead loads, compressibility) are there although
        they are off; what follows one of them from nothing needs that.
    """

    def __init__(self, mesh: Mesh, physics: Mapping, extended: bool = False):
        loading = physics["loading"]
        self._numbers: dict[str, Any] = {}
        self.parameters = StiffnessInputs.from_spec(physics["parameters"])
        self.channels = Channels.from_config(physics)
        self.full_pressure = loading["pressure_mmhg"]
        self.material = material_from_config(physics["material"])
        supports = supports_from_config(physics["supports"])
        bulk = physics["material"]["bulk_modulus_kpa"]
        self._compressibility = 0.0 if bulk is None else 1 / bulk
        self._extended = extended
        self.domain, origin = api.hexahedral_mesh(mesh.points, mesh.cells)
        self.segment = mesh.segment[origin] - 1
        self._stress_factor = segment_factors(physics["material"])[self.segment]
        api.require_cellwise_order(self.domain)
        space = api.mixed_space(self.domain, api.element_order(mesh.cells))
        base = next((s for s in supports if isinstance(s, Base)), None)
        held_axially = base is not None and base.holds("axial")
        loads = {name: loading[name] for name in LOADS if name in loading}
        residual, tangent, terms = self._build_forms(
            space, mesh, physics["fibres"], supports, loads, held_axially
        )
        self.displacement_dofs, self.displacement_nodes = displacement_nodes(space)
        self.pressure_dofs, self.pressure_nodes = api.tabulated_dofs(space.sub(1))
        self._build_observer(mesh, physics["observables"])
        # With the base in a plane perpendicular to the axis, in which it stays, a uniform pressure
        # has a potential, the cavity's volume, and the tangent is symmetric. Cell-wise constant
        # pressures leave so many zeros on the diagonal that their symmetric factorisation takes
        # three times as long as the general one.
        flat = np.ptp(mesh.points[mesh.nodes_on(BASE), 2]) < FLAT_MM
        symmetric = flat and held_axially and api.element_order(mesh.cells) == 2
        fixed, rotation = self._held(mesh, base)
        super().__init__(self.w, residual, tangent, fixed, rotation, symmetric, terms)

    # ---------------------------------------------------------------- the weak form

    def _held(self, mesh: Mesh, base: Base | None):
        """Held degrees of freedom, and the turned nodes (`equilibrium.Rotation`)."""
        if base is None:
            return np.zeros(0, dtype=int), None
        at_base = mesh.nodes_on(BASE)
        return base.held(self._node_dofs[at_base], mesh.points[at_base])

    def _constant(self, value: float, name: str):
        """A constant of the forms, kept under its name."""
        self._numbers[name] = api.fem.Constant(self.domain, float(value))
        return self._numbers[name]

    def _build_forms(self, space, mesh: Mesh, fibres, supports, loads, held_axially: bool):
        """Residual, tangent and further terms, not compiled yet."""
        self.w = api.fem.Function(space)
        domain = self.domain
        quadrature = {"quadrature_degree": QUADRATURE_DEGREE}
        tags = api.facet_tags(domain, mesh.facets[:, :4], mesh.surface)
        dx = ufl.Measure("dx", domain, metadata=quadrature)
        ds = ufl.Measure("ds", domain, subdomain_data=tags, metadata=quadrature)
        u, p = ufl.split(self.w)
        F = deformation_gradient(u)

        cellwise = api.space(domain, "DG", 0)
        self._factors = {name: api.fem.Function(cellwise) for name in self.material.references}
        self.pressure_kpa = self._constant(0.0, "pressure_kpa")
        transmural = api.fem.Function(api.space(domain, "Lagrange", api.element_order(mesh.cells)))
        transmural.x.array[:] = _nodal_values(transmural, mesh)
        turn = self._turn_of_segments(fibres, cellwise)
        fibre, sheet = fibre_directions(transmural, fibres, self._constant, turn)
        constants = self.material.scaled(self._factors, self._constant)
        energy = self.material.energy(F, fibre, sheet, constants)
        test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
        v, _ = ufl.split(test)
        inside = virtual_work(energy, self.w, test, dx)
        self._by_factors = ByCell(domain, inside, list(self._factors.values()))
        residual = inside + self.pressure_kpa * cavity_work(u, v, domain, ds)
        terms = []
        surroundings = Surroundings(domain, u, ds, self.segment)
        valves = None
        if self._extended or not held_axially:
            valves = self._constant(valve_plane_share(mesh), "valves")
        potentials = self._potentials(surroundings, supports, loads, valves)
        if self._extended or self._compressibility:
            number = self._constant(self._compressibility, "compressibility")
            potentials = [*potentials, ([number], -number * p**2 / 2 * dx)]
        for numbers, potential in potentials:
            derivative = ufl.derivative(potential, self.w, test)
            terms.append(Term(numbers, derivative, self.w, trial))
        self._dilation = api.compile_form(abs(ufl.det(F) - 1) * dx)
        return residual, ufl.derivative(residual, self.w, trial), terms

    def _turn_of_segments(self, fibres: Mapping, cellwise):
        """What single segments add to the helix angle (rad): a field, or 0 where none does."""
        turned = fibres.get("segment_helix_deg")
        if not turned:
            return 0.0
        angles = np.zeros(len(SEGMENTS))
        angles[[segment - 1 for segment in turned]] = np.deg2rad([*turned.values()])
        field = api.fem.Function(cellwise)
        field.x.array[:] = angles[self.segment]
        return field

    def _potentials(self, surroundings, supports, loads, valves):
        """Potentials of springs and dead loads, each with its numbers: those that are on, or all of
        them.

        valves: constant of the load on the valves, None where the base does not move along it.
        """
        for support in supports:
            springs = support.springs
            if not self._extended:
                springs = {name: stiffness for name, stiffness in springs.items() if stiffness}
            if springs:
                sizes = {name: self._constant(value, name) for name, value in springs.items()}
                yield list(sizes.values()), support.energy(surroundings, sizes)
        # Dead loads grow with the cavity's pressure up to their own size.
        for name, size in loads.items():
            if size or self._extended:
                share = self._constant(size / self.full_pressure, name)
                yield [share], LOADS[name]().potential(surroundings, share * self.pressure_kpa)
        if valves is not None:
            yield [valves], valve_plane_potential(surroundings, self.pressure_kpa, valves)

    def _build_observer(self, mesh: Mesh, observed: dict) -> None:
        self.observer = Observer(mesh, observed)
        self._channels_at = {
            fraction: (
                np.flatnonzero(self.channels.at(fraction)),
                [c for c in self.channels if c.load_fraction == fraction],
            )
            for fraction in self.channels.load_fractions
        }
        # Nodes of the mesh among those of the displacement, and of the linear pressure.
        distance, node = cKDTree(self.displacement_nodes).query(mesh.points)
        if distance.max() > 1e-6:
            raise ValueError("the mesh's nodes are not those of the displacement")
        self._node_dofs = self.displacement_dofs[node]
        self._wall_volume = self.observer.wall.volume.sum()
        # Degrees of freedom (cells, 8) of the pressure at the corners of the mesh's cells.
        self._pressure_at = None
        if self._extended or self._compressibility:
            corners = mesh.points[mesh.cells[:, :8]]
            if api.element_order(mesh.cells) == 1:
                # One pressure in each cell: that of its centre.
                corners = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
            self._pressure_at = self.pressure_dofs[cKDTree(self.pressure_nodes).query(corners)[1]]

    # --------------------------------------------------------------------- the problem

    def set(self, theta: np.ndarray, pressure: float) -> None:
        """Set theta (P,) and the cavity pressure (mmHg), with which the dead loads grow."""
        table = self.parameters.table(np.asarray(theta, dtype=float))
        zones = self.parameters.segment_zone[self.segment]
        for name, function in self._factors.items():
            inferred = name in self.parameters.factors
            values = table[zones, self.parameters.factors.index(name)] if inferred else 1.0
            if name == self.material.stress_factor():
                values = values * self._stress_factor
            function.x.array[:] = values
        self.pressure_kpa.value = pressure * KPA_PER_MMHG

    @property
    def coordinates(self) -> Coordinates:
        """Of what `set` takes."""
        return self.parameters.coordinates

    @property
    def middle(self) -> np.ndarray:
        """Theta (P,) from which every other one is within reach."""
        return self.parameters.middle

    @property
    def reference(self) -> np.ndarray:
        """Theta (P,) of the reference material."""
        return np.ones(len(self.parameters))

    def stiffer(self, theta: np.ndarray, factor: float) -> np.ndarray:
        """Theta (P,) of a ventricle all of whose stresses are `factor` times as large."""
        return np.where(self.parameters.scales_stress, factor * theta, theta)

    # -------------------------------------------------------------- what is observed

    def differentiated(
        self, state: State, fraction: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values (d,) of the channels at a load whose solution `state` is, their derivatives (k, d)
        about the scaled coordinates of theta, and the `tangents`."""
        fields = self.tangents(state)
        values, slopes = self.observables(state.w, fields, fraction)
        assert slopes is not None
        return values, slopes, fields

    def displacement(self, w: np.ndarray) -> np.ndarray:
        """Displacement (..., n, 3), mm, at the nodes of the mesh, of fields `w` (..., size)."""
        return w[..., self._node_dofs]

    def observables(
        self, w: np.ndarray, directions: np.ndarray | None = None, fraction: float = 1.0
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Values (d,) of the channels at a load `fraction`, of whose load `w` is a solution, and
        their derivatives (k, d) along fields `directions` (k, size), None without any."""
        channels = self._channels_at[fraction][1]
        moves = None if directions is None else self.displacement(directions)
        dilation_moves = None
        if self._pressure_at is not None and directions is not None:
            dilation_moves = self._compressibility * directions[:, self._pressure_at]
        return self.observer.observe(
            channels, self.displacement(w), self.wall_dilation(w), moves, dilation_moves
        )

    def wall_dilation(self, w: np.ndarray) -> float | np.ndarray:
        """The change of volume that the wall allows in a solution `w`, as `Observer.values` takes
        it: 1, or what the pressure makes of it at the corners (cells, 8) of a compressible wall."""
        if self._pressure_at is None:
            return 1.0
        return 1 + self._compressibility * w[self._pressure_at]

    def places_of(self, fraction: float) -> np.ndarray:
        """Where in `channels` those at a load fraction stand."""
        return self._channels_at[fraction][0]

    def tangents(self, state: State) -> np.ndarray:
        """Derivatives (k, size) of the field with respect to the scaled coordinates of theta, by
        back-substitution with the factor at hand."""
        self._place(state.w)
        zones, factors = len(self.parameters.zones), self.parameters.factors
        in_zone = np.arange(zones)[:, None] == self.parameters.segment_zone[self.segment]
        inferred = np.array([[name == factor for name in self._factors] for factor in factors])
        logs = in_zone[:, None, None] * inferred[..., None]
        return -self.solve(self._resisted(self._factor_forces(logs.reshape(-1, *logs.shape[2:]))))

    def _factor_forces(self, logs: np.ndarray) -> np.ndarray:
        """Changes (K, size) of the residual in place, in x, y and nothing held, per unit of changes
        `logs` (K, factors, cells) of the logarithms of the law's factors."""
        values = np.stack([function.x.array for function in self._factors.values()])
        return self._by_factors.along((logs * values).swapaxes(1, 2))

    def dilation(self, w: np.ndarray) -> float:
        """Volume average of |det F - 1|, zero for an incompressible wall."""
        self.w.x.array[:] = w
        return api.fem.assemble_scalar(self._dilation) / self._wall_volume


def _nodal_values(function, mesh: Mesh) -> np.ndarray:
    """Values of the mesh's transmural coordinate at the nodes of a function of its order."""
    nodes = function.function_space.tabulate_dof_coordinates()
    distance, nearest = cKDTree(mesh.points).query(nodes)
    if distance.max() > 1e-6:
        raise ValueError("mesh nodes and function nodes do not coincide")
    return mesh.transmural[nearest]
