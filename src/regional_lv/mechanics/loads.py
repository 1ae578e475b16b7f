"""What loads the ventricle: pressures that grow together from nothing to their end-diastolic value.

A load is one class and one entry in `LOADS`, under the key of the section `loading` that gives its
size. The cavity's pressure is the study's own and always there; the others are dead loads, which
keep their size per unloaded area: they have a potential, and the tangent stays symmetric.
"""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import ClassVar

import numpy as np

from regional_lv.aha import SEPTUM
from regional_lv.geometry.elements import facet_normal_changes, facet_normals, gauss
from regional_lv.geometry.mesh import BASE, ENDOCARDIUM, EPICARDIUM, Mesh
from regional_lv.registry import Registry

# UFL and dolfinx are imported where forms are made: the configuration is checked without them.


class Load(ABC):
    """A dead load; `size` is what the configuration says under `loading.<name>` (mmHg)."""

    name: ClassVar[str]

    @abstractmethod
    def potential(self, surroundings, size):
        """Potential (kPa mm3), a UFL form, of the load `size` (a constant, kPa) on the wall; none
        at size 0.

        surroundings: a `supports.Surroundings`.
        """


class SeptalPressure(Load):
    """The right ventricle's pressure on the septum, along the normal of its unloaded epicardium.

    In cylindrical components: it turns with the material about the long axis only.
    """

    name = "septal_pressure_mmhg"

    def potential(self, surroundings, size):
        from regional_lv.mechanics import dolfinx_api as api

        septal = api.fem.Function(api.space(surroundings.domain, "DG", 0))
        septal.x.array[:] = np.isin(surroundings.segment + 1, SEPTUM)
        return size * septal * surroundings.along_normal * surroundings.ds(EPICARDIUM)


LOADS = Registry("load", "loading", (SeptalPressure,))


def cavity_work(u, v, domain, ds):
    """Virtual work (linear form in `v`) per kPa of the follower pressure on the endocardium."""
    import ufl

    from regional_lv.mechanics.equilibrium import deformation_gradient, deformed_normal

    return ufl.inner(deformed_normal(deformation_gradient(u), domain), v) * ds(ENDOCARDIUM)


def valve_plane_potential(surroundings, pressure, share):
    """Potential of the cavity's `pressure` (kPa) on the valves, carried by the base.

    share: a constant, `valve_plane_share` of the mesh.

    A dead traction along the axis, evenly over the base: the pressure times the unloaded area of
    the valve plane. Where the base is held along its axis it would do no work; where it is not, the
    pressure on the endocardium alone would push the heart away.
    """
    return -pressure * share * surroundings.axial * surroundings.ds(BASE)


def valve_plane_share(mesh: Mesh) -> float:
    """Unloaded area of the valve plane over that of the base."""
    # Over the closed surface of the cavity normals cancel.
    return float(np.divide(*(_towards_base(mesh, surface) for surface in (ENDOCARDIUM, BASE))))


def valve_plane_share_changes(mesh: Mesh, moves: np.ndarray) -> np.ndarray:
    """Changes (K,) of `valve_plane_share` per unit of moves (K, n, 3) of the nodes."""
    valves, base = (_towards_base(mesh, surface, moves) for surface in (ENDOCARDIUM, BASE))
    area = _towards_base(mesh, BASE)
    return (valves - valve_plane_share(mesh) * base) / area


def _towards_base(mesh: Mesh, surface: int, moves: np.ndarray | None = None):
    """Area (mm2) of a surface's projection along the axis, or its changes (K,); normals point out
    of the wall."""
    points, weights = gauss(2)
    mine = replace(mesh, facets=mesh.facets[mesh.surface == surface])
    if moves is None:
        return (facet_normals(mine, points)[..., 2] @ weights).sum()
    return (facet_normal_changes(mine, points, moves)[..., 2] @ weights).sum(axis=-1)
