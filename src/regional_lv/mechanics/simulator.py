"""The left ventricle's inflation as a finite element problem: residual, tangent, observables.

Hexahedra for displacement and pressure (u-p, incompressible), quadratic with linear pressure or
linear with piecewise constant pressure as the mesh is; follower pressure on the endocardium,
supported base. This module knows one equilibrium problem; how a solution is reached is the business
of `continuation`. What a study can add to this base model stands in `effects`.
"""

from dataclasses import dataclass

import numpy as np
import ufl
from scipy.spatial import cKDTree

from regional_lv import aha
from regional_lv.geometry.mesh import BASE, ENDOCARDIUM, Mesh
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.mechanics import effects
from regional_lv.mechanics.effects import radial_displacement
from regional_lv.mechanics.equilibrium import (
    Equilibrium,
    Rotation,
    deformation_gradient,
    deformed_normal,
    displacement_nodes,
    virtual_work,
)
from regional_lv.mechanics.material import HolzapfelOgden, strain_energy
from regional_lv.mechanics.segments import Averages
from regional_lv.units import KPA_PER_MMHG

QUADRATURE_DEGREE = 5  # three Gauss points per direction

ROOT_STEPS = 8  # of the square root's invariants: errors below 1e-9

LAYERS = {
    "wall": (0.0, 1.0),
    "endocardium": (0.0, 1 / 3),
    "midwall": (1 / 3, 2 / 3),
    "epicardium": (2 / 3, 1.0),
}
"""Transmural bounds (0 endocardium, 1 epicardium) over which strains are averaged."""


@dataclass(frozen=True)
class State:
    """A solution: degrees of freedom `w`, parameters `theta` (10,) and `pressure` (mmHg)."""

    w: np.ndarray
    theta: np.ndarray
    pressure: float


class Simulator(Equilibrium):
    """Equilibrium of one left ventricle for any theta and pressure.

    Parameters
    ----------
    mesh: geometry with segments, surfaces and the transmural coordinate (mm).
    config: the study's config; reads `material`, `fibres`, `loading`, `observables`.
    extended: whether the terms of all effects are there (`effects`) although all of them are off;
        what follows an effect from its base value on needs them. They add a tenth to a Newton step.
    """

    def __init__(self, mesh: Mesh, config: dict, extended: bool = False):
        self._extended = extended or effects.any_on(config)
        self.domain, origin = api.hexahedral_mesh(mesh.points, mesh.cells)
        self.segment = mesh.segment[origin] - 1
        self.zone = aha.SEGMENT_ZONE[self.segment]
        self._segment_factor = effects.segment_factors(config)[self.segment]
        api.require_cellwise_order(self.domain)
        space = api.mixed_space(self.domain, api.element_order(mesh.cells))
        residual, tangent = self._build_forms(space, mesh, config)
        self.displacement_dofs, self.displacement_nodes = displacement_nodes(space)
        self.pressure_dofs, self.pressure_nodes = api.tabulated_dofs(space.sub(1))
        # Every support holds the base in its plane: a uniform pressure then has a potential, the
        # cavity's volume, and the tangent is symmetric.
        compliant = config["loading"].get("basal_compliance_mm_per_kpa", 0.0) > 0
        fixed, rotation = self._supports(
            "radial_spring" if compliant else config["loading"]["base"]
        )
        # Cell-wise constant pressures leave so many zeros on the diagonal that their symmetric
        # factorisation takes three times as long as the general one.
        symmetric = api.element_order(mesh.cells) == 2
        super().__init__(self.w, residual, tangent, fixed, rotation, symmetric)

    # ---------------------------------------------------------------- the weak form

    def _build_forms(self, space, mesh: Mesh, config: dict):
        """Compile all forms but residual and tangent, which are returned."""
        self.w = api.fem.Function(space)
        domain, loading = self.domain, config["loading"]
        quadrature = {"quadrature_degree": QUADRATURE_DEGREE}
        tags = api.facet_tags(domain, mesh.facets[:, :4], mesh.surface)
        dx = ufl.Measure("dx", domain, metadata=quadrature)
        ds = ufl.Measure("ds", domain, subdomain_data=tags, metadata=quadrature)
        u, p = ufl.split(self.w)
        F = deformation_gradient(u)
        effect = effects.Constants(domain, config) if self._extended else None

        self.c_a, self.c_b = (api.fem.Function(api.space(domain, "DG", 0)) for _ in range(2))
        self.pressure_kpa = api.fem.Constant(domain, 0.0)
        transmural = api.fem.Function(api.space(domain, "Lagrange", api.element_order(mesh.cells)))
        transmural.x.array[:] = _nodal_values(transmural, mesh)
        fibre, sheet = fibre_directions(
            transmural, config["fibres"], effect.rotation if effect else None
        )

        reference = HolzapfelOgden.from_config(config["material"])
        if effect:
            reference = reference._replace(a_f=effect.anisotropy * reference.a_f)
        energy = strain_energy(F, fibre, sheet, reference, self.c_a, self.c_b)
        if effect:
            energy -= effect.compressibility * p**2 / 2
        test = ufl.TestFunction(space)
        v, _ = ufl.split(test)
        load = ufl.inner(deformed_normal(F, domain), v) * ds(ENDOCARDIUM)
        residual = virtual_work(energy, self.w, test, dx) + self.pressure_kpa * load
        if loading["base"] == "radial_spring":
            stiffness = loading["base_spring_kpa_per_mm"] / 2
            spring = stiffness * radial_displacement(domain, u) ** 2 * ds(BASE)
            residual += ufl.derivative(spring, self.w, test)
        if effect:
            outside = effects.surface_energy(domain, u, effect, self.segment, ds)
            residual += ufl.derivative(outside, self.w, test)

        # d(residual)/d(log C) of one zone: the same kernel on that zone's cells only.
        self._parameter_forms = []
        for zone in range(len(aha.ZONES)):
            cells = api.cell_tags(domain, np.flatnonzero(self.zone == zone))
            dz = ufl.Measure("dx", domain, subdomain_data=cells, metadata=quadrature)
            in_zone = virtual_work(energy, self.w, test, dz(1))
            for factor in (self.c_a, self.c_b):
                form = ufl.derivative(in_zone, factor, factor)
                self._parameter_forms.append(api.compile_form(form))

        dilation = 1 + effect.compressibility * p if effect else 1.0
        self._build_observables(space, transmural, dx, ds, config["observables"], dilation)
        return residual, ufl.derivative(residual, self.w, ufl.TrialFunction(space))

    def _build_observables(self, space, transmural, dx, ds, observed: dict, dilation) -> None:
        domain = self.domain
        u, _ = ufl.split(self.w)
        F = deformation_gradient(u)
        J = ufl.det(F)
        # Strains look back from the end-diastolic configuration, E = (F^-T F^-1 - I) / 2, along
        # directions of that configuration: the wall's normal there, the horizontal tangent, and
        # the tangent across it.
        # The wall keeps its volume, so the adjugate J F^-1 is the inverse; where the discrete
        # J strays from 1, next to the held edge of the base, it does not blow the error up. In a
        # compressible wall J is `dilation`.
        back = J * ufl.inv(F) if isinstance(dilation, float) else J / dilation * ufl.inv(F)
        directions = local_directions(back.T * ufl.grad(transmural))
        strains = [(ufl.dot(back * q, back * q) - 1) / 2 for q in directions]
        if observed.get("nominal_share", 0.0):
            share = api.fem.Constant(domain, float(observed["nominal_share"]))
            stretch = square_root(back.T * back)
            nominal = [ufl.dot(q, stretch * q) - 1 for q in directions]
            strains = [g + share * (n - g) for g, n in zip(strains, nominal, strict=True)]
        self._direction = api.fem.Function(space)

        def averages(region):
            lower, upper = LAYERS[region]
            inside = ufl.And(ufl.ge(transmural, lower), ufl.le(transmural, upper))
            return Averages(
                domain,
                self.segment,
                strains,
                ufl.conditional(inside, 1.0, 0.0),
                dx,
                (self.w, self._direction),
                observed.get("segment_rotation_deg", 0.0),
            )

        share = observed.get("endocardial_share", 0.0)
        self._averages = [(1 - share, averages(observed["region"]))]
        if share:
            self._averages.append((share, averages("endocardium")))
        self.segment_volume = self._averages[0][1].volume

        # Divergence theorem with the field (0, 0, z): the lid at the base, z = 0, adds nothing.
        z = ufl.SpatialCoordinate(domain)[2] + u[2]
        cavity = -z * deformed_normal(F, domain)[2] * ds(ENDOCARDIUM)
        self._cavity = api.compile_form(cavity)
        self._cavity_gradient = api.compile_form(
            ufl.derivative(cavity, self.w, ufl.TestFunction(space))
        )
        self._dilation = api.compile_form(abs(J - 1) * dx)

    def _supports(self, base: str) -> tuple[np.ndarray, Rotation]:
        """Degrees of freedom that the base holds, in cylindrical components of its nodes."""
        dofs, nodes = self.displacement_dofs, self.displacement_nodes
        on_base = np.flatnonzero(np.abs(nodes[:, 2] - nodes[:, 2].max()) < 1e-6)
        angle = np.arctan2(nodes[on_base, 1], nodes[on_base, 0])
        radial, around, axial = dofs[on_base].T
        fixed = [axial]
        if base in ("u_r_u_z_fixed", "fixed"):
            fixed.append(radial)
        if base in ("u_z_u_theta_fixed", "fixed"):
            fixed.append(around)
        if base in ("u_r_u_z_fixed", "radial_spring"):
            # Equilibrium leaves the rotation about the long axis free, and no load turns: holding
            # one node removes it without any reaction. A spring leaves translation to the springs.
            fixed.append(around[:1])
        circle = nodes[on_base, :2] if base == "u_r_u_z_fixed" else None
        return np.concatenate(fixed), Rotation(radial, around, angle, circle)

    # --------------------------------------------------------------------- the problem

    def set(self, theta: np.ndarray, pressure: float) -> None:
        """Set the scaling factors theta (10,) and the cavity pressure (mmHg)."""
        theta = np.asarray(theta, dtype=float).reshape(5, 2)
        self.c_a.x.array[:] = theta[self.zone, 0] * self._segment_factor
        self.c_b.x.array[:] = theta[self.zone, 1]
        self.pressure_kpa.value = pressure * KPA_PER_MMHG

    # -------------------------------------------------------------- what is observed

    def observables(self, w: np.ndarray) -> np.ndarray:
        """The 52 outputs of `aha.OUTPUTS` (volume in mL, Green strains) at `w`."""
        self.w.x.array[:] = w
        volume = api.fem.assemble_scalar(self._cavity) / 1000.0
        return np.concatenate([[volume], self._mixed([a.means() for _, a in self._averages])])

    def field_sensitivities(self, w: np.ndarray) -> np.ndarray:
        """d(w)/d(log theta), (10, size), by back-substitution with the factor at hand."""
        self._place(w)
        rows = []
        for form in self._parameter_forms:
            rows.append(-self.solve(self._assembled(form)))
        return np.stack(rows)

    def directional_derivatives(self, w: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Derivatives (k, 52) of the outputs at `w` along fields `directions` (k, size)."""
        self.w.x.array[:] = w
        gradient = api.assemble_vector(np.zeros(self.size), self._cavity_gradient) / 1000.0
        rows = []
        for direction in directions:
            self._direction.x.array[:] = direction
            strains = self._mixed([a.derivatives() for _, a in self._averages])
            rows.append(np.concatenate([[gradient @ direction], strains]))
        return np.stack(rows)

    def dilation(self, w: np.ndarray) -> float:
        """Volume average of |det F - 1|, zero for an incompressible wall."""
        self.w.x.array[:] = w
        return api.fem.assemble_scalar(self._dilation) / self.segment_volume.sum()

    def _mixed(self, strains: list[np.ndarray]) -> np.ndarray:
        return sum(share * e for (share, _), e in zip(self._averages, strains, strict=True))


def square_root(c):
    """The square root of a symmetric positive definite 3 x 3 tensor.

    By its invariants I, II, III, from the theorem of Cayley and Hamilton: (I c + III 1) times the
    inverse of c + II 1 (Hoger and Carlson 1984, doi 10.1090/qam/736511). Those satisfy
    I^2 = tr c + 2 II and II^2 = II_c + 2 III I. Solving the two in turn divides the error by nine
    or more where det c = 1, and needs no eigenvalues, whose derivatives fail where two are equal.
    """
    trace, second = ufl.tr(c), (ufl.tr(c) ** 2 - ufl.tr(c * c)) / 2
    third = ufl.sqrt(ufl.det(c))
    first = ufl.sqrt(trace + 6 * ufl.det(c) ** (1 / 3))
    for _ in range(ROOT_STEPS):
        other = ufl.sqrt(second + 2 * third * first)
        first = ufl.sqrt(trace + 2 * other)
    other = ufl.sqrt(second + 2 * third * first)
    eye = ufl.Identity(3)
    return (first * c + third * eye) * ufl.inv(c + other * eye)


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


def fibre_directions(transmural, fibres: dict, rotation=None):
    """Fibre and sheet unit vectors: angles linear through the wall (UFL expressions).

    The helix angle turns the fibre from circumferential towards the base, the sheet angle turns
    the sheet from radial towards the in-wall normal of the fibre. `rotation` (rad) is added to the
    helix angle at the endocardium and taken from that at the epicardium.
    """
    circumferential, radial, longitudinal = local_directions(ufl.grad(transmural))

    def angle(kind):
        endo, epi = (np.deg2rad(fibres[f"{kind}_{side}_deg"]) for side in ("endo", "epi"))
        return endo + (epi - endo) * transmural

    helix, tilt = angle("helix"), angle("sheet")
    if rotation is not None:
        helix += rotation * (1 - 2 * transmural)
    fibre = ufl.cos(helix) * circumferential + ufl.sin(helix) * longitudinal
    across = ufl.cross(radial, fibre)
    sheet = ufl.cos(tilt) * radial + ufl.sin(tilt) * across
    return fibre, sheet


def _nodal_values(function, mesh: Mesh) -> np.ndarray:
    """Values of the mesh's transmural coordinate at the nodes of a function of its order."""
    nodes = function.function_space.tabulate_dof_coordinates()
    distance, nearest = cKDTree(mesh.points).query(nodes)
    if distance.max() > 1e-6:
        raise ValueError("mesh nodes and function nodes do not coincide")
    return mesh.transmural[nearest]
