"""Bodies for verification: structured hexahedra, one material, pressure on one surface."""

import numpy as np
import ufl

from regional_lv.geometry.elements import FACES, NODES
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.mechanics.continuation import Effort, Solver
from regional_lv.mechanics.equilibrium import (
    Equilibrium,
    deformation_gradient,
    deformed_normal,
    displacement_nodes,
    virtual_work,
)
from regional_lv.mechanics.simulator import QUADRATURE_DEGREE


def block(shape: tuple[int, int, int], place) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and cells (m, 27) of a block of `shape` hexahedra.

    `place` maps the coordinates (n, 3) of the unit cube's nodes to points.
    """
    size = 2 * np.array(shape) + 1
    lattice = _lattice([np.linspace(0, 1, n) for n in size])
    first = _lattice([2 * np.arange(n) for n in shape])
    places = first[:, None, :] + (NODES + 1).astype(int)
    return place(lattice), np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), size.tolist())


def join(blocks) -> tuple[np.ndarray, np.ndarray]:
    """One mesh of several blocks, points that coincide made one."""
    starts = np.cumsum([0, *(len(points) for points, _ in blocks)])
    points = np.concatenate([points for points, _ in blocks])
    cells = np.concatenate([c + start for (_, c), start in zip(blocks, starts, strict=False)])
    # The sum with zero turns -0 into 0, which it would not be equal to.
    _, kept, name = np.unique(
        np.round(points, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    return points[kept], name.ravel()[cells]


def _lattice(axes) -> np.ndarray:
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


class Body(Equilibrium):
    """Equilibrium of an incompressible solid under a follower pressure (kPa).

    Parameters
    ----------
    points (n, 3) mm, cells (m, 27): mesh in VTK order.
    loaded: (n,) bool; the pressure acts on the outer faces whose corners all are.
    energy: function of F and the domain, the strain energy density (UFL, kPa).
    supports: function of the displacement's dofs (n, 3) and their nodes (n, 3) that gives the
        fixed dofs and, if nodes are turned, the `Rotation`.
    """

    def __init__(self, points, cells, loaded, energy, supports):
        self.domain, _ = api.hexahedral_mesh(points, cells)
        space = api.mixed_space(self.domain)
        w, test = api.fem.Function(space), ufl.TestFunction(space)
        faces = cells[:, FACES].reshape(-1, 4)
        faces = faces[loaded[faces].all(axis=1)]
        tags = api.facet_tags(self.domain, faces, np.ones(len(faces), dtype=int))
        quadrature = {"quadrature_degree": QUADRATURE_DEGREE}
        self.dx = ufl.Measure("dx", self.domain, metadata=quadrature)
        ds = ufl.Measure("ds", self.domain, subdomain_data=tags, metadata=quadrature)
        self.u, _ = ufl.split(w)
        self.F = deformation_gradient(self.u)
        self._flux = deformed_normal(self.F, self.domain), ds(1)
        self.pressure = api.fem.Constant(self.domain, 0.0)
        normal, surface = self._flux
        load = self.pressure * ufl.inner(normal, ufl.split(test)[0]) * surface
        residual = virtual_work(energy(self.F, self.domain), w, test, self.dx) + load
        self.displacement_dofs, self.displacement_nodes = displacement_nodes(space)
        tangent = ufl.derivative(residual, w, ufl.TrialFunction(space))
        fixed = supports(self.displacement_dofs, self.displacement_nodes)
        super().__init__(w, residual, tangent, *fixed)

    def set(self, theta: np.ndarray, pressure: float) -> None:
        """Set the pressure (kPa); there is no theta here, `Solver` passes an empty one."""
        self.pressure.value = pressure

    def inflate(self, pressure: float, settings: dict) -> np.ndarray:
        """The field (size,) at `pressure` (kPa); `settings` is the config's section `solver`."""
        return Solver(self, settings).inflate(np.zeros(0), pressure, Effort()).w

    def integral(self, w: np.ndarray, form) -> float:
        """Integral of a UFL form, at the field `w`."""
        self.w.x.array[:] = w
        return api.fem.assemble_scalar(api.compile_form(form))

    def cavity(self, w: np.ndarray, field) -> float:
        """Deformed volume (mm^3) under the loaded surface by the divergence theorem.

        `field` is a function of the deformed position with divergence 1 that does not flow
        through what else closes the cavity.
        """
        normal, surface = self._flux
        position = ufl.SpatialCoordinate(self.domain) + self.u
        return self.integral(w, -ufl.dot(field(position), normal) * surface)

    def deformed(self, w: np.ndarray, point) -> np.ndarray:
        """Deformed position (3,) of a node given by its place at rest."""
        distance = np.linalg.norm(self.displacement_nodes - np.asarray(point), axis=1)
        node = int(distance.argmin())
        if distance[node] > 1e-6:
            raise ValueError(f"the mesh has no node at {point}")
        return self.displacement_nodes[node] + w[self.displacement_dofs[node]]
