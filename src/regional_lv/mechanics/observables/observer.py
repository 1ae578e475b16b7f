"""Observes a solution: from nodal displacements to the values of channels and their derivatives."""

import copy
from collections.abc import Mapping, Sequence

import numpy as np
import torch

from regional_lv.aha import LEVELS, SEGMENTS
from regional_lv.channels import Channel
from regional_lv.geometry.mesh import Mesh
from regional_lv.mechanics.observables.motion import Motion, PointMotion
from regional_lv.mechanics.observables.strain_measure import StrainMeasure
from regional_lv.mechanics.observables.wall import Cavity, Wall


class Observer:
    """Values of channels under a displacement of the mesh's nodes, and derivatives along others.

    Parameters
    ----------
    mesh: the unloaded wall.
    observed: section `observables` of the configuration; read are `layer`, `strain_exponent`,
        `line_share`, `unloaded_share` and `segment_rotation_deg`, which hold for the wall strains
        alone, and `scale`.
    """

    def __init__(self, mesh: Mesh, observed: Mapping):
        self.wall, self.cavity = Wall(mesh), Cavity(mesh)
        self._whole = self.wall.shares((0.0, 1.0), 0.0)
        self._place = torch.as_tensor(self.wall.place)
        self._depth_gradient = torch.as_tensor(self.wall.depth_gradient)
        self._look(observed)

    def looking(self, observed: Mapping) -> "Observer":
        """An observer of the same wall with other `observed`: it costs next to nothing."""
        other = copy.copy(self)
        other._look(observed)
        return other

    def _look(self, observed: Mapping) -> None:
        self.measure = StrainMeasure(observed["strain_exponent"], observed["line_share"])
        self._unloaded_share = observed["unloaded_share"]
        asked = tuple(observed["layer"]), observed["segment_rotation_deg"]
        whole = asked == ((0.0, 1.0), 0.0)
        self._sampled = self._whole if whole else self.wall.shares(*asked)
        self._scale = observed["scale"]

    def values(
        self,
        channels: Sequence[Channel],
        displacement: np.ndarray,
        dilation: float | np.ndarray | None = None,
    ) -> np.ndarray:
        """Values (D,) of `channels`, whose load is that of the motion.

        displacement: (n, 3) mm at the mesh's nodes. dilation: the change of volume that the wall
        allows, one number or (cells, 8) at the corners, linear in each cell, which sets the stretch
        across the wall (`PointMotion.back`); None takes the deformation gradient as it is.
        """
        return self.observe(channels, displacement, dilation)[0]

    def observe(
        self,
        channels: Sequence[Channel],
        displacement: np.ndarray,
        dilation: float | np.ndarray | None = None,
        moves: np.ndarray | None = None,
        dilation_moves: np.ndarray | None = None,
        node_moves: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """As `values`, and if there are `moves`, the values' derivatives (k, D) along these.

        moves: (k, n, 3) changes of the displacement, dilation_moves (k, cells, 8) those of the
        dilation and node_moves (k, n, 3) those of the unloaded nodes that go with them. Derivatives
        are exact: those of the values that are returned. Of moving nodes they take the angles about
        the axis, which turned segments depend on, as fixed.
        """
        kinds: dict = {}
        for at, channel in enumerate(channels):
            kinds.setdefault(channel.kind, []).append((at, channel.place))
        point = self.point_motion(displacement, dilation, moves is not None)
        with torch.set_grad_enabled(moves is not None):
            densities = {}
            for kind in kinds:
                for name, density in kind().densities(point).items():
                    densities[name] = density, self._sampled if kind.is_strain else self._whole
        means = {
            name: torch.tensor(shares @ density.detach().numpy())
            for name, (density, shares) in densities.items()
        }
        cavity, cavity_gradient = self.cavity.volume_and_gradient(displacement[self.cavity.nodes])
        axis, axis_gradient = self._long_axis(displacement)
        loaded, unloaded = (torch.tensor(length, dtype=torch.float64) for length in axis)
        volumes = torch.tensor(self.wall.segment_volumes)
        leaves = [*means.values(), torch.tensor(cavity, dtype=torch.float64), loaded]
        leaves += [unloaded, volumes]
        for leaf in leaves:
            leaf.requires_grad_(moves is not None)
        with torch.set_grad_enabled(moves is not None):
            motion = Motion(
                dict(zip(means, leaves, strict=False)),
                level_shares(volumes),
                leaves[len(means)],
                (loaded, unloaded),
            )
            order: list[int] = []
            found = []
            for kind, asked in kinds.items():
                rows, places = zip(*asked, strict=True)
                order += rows
                found.append(self._scale.get(kind.name, 1.0) * kind().values(motion, places))
            found = torch.cat(found)
        values = np.empty(len(order))
        values[order] = found.detach().numpy()
        if moves is None:
            return values, None
        carried, nodes = moves, None
        if node_moves is not None:
            carried, nodes = moves + node_moves, NodeMoves(self.wall, node_moves)
        slopes = [
            *self._mean_slopes(point, densities, moves, dilation_moves, nodes),
            np.einsum("mx,kmx->k", cavity_gradient, carried[:, self.cavity.nodes])[:, None],
            np.einsum("nx,knx->k", axis_gradient, carried[:, self.cavity.nodes])[:, None],
        ]
        if nodes is not None:
            slopes += self._unloaded_slopes(axis_gradient, nodes, len(moves))
        derivatives = np.zeros((len(moves), len(order)))
        for column, value in zip(order, found, strict=True):
            by_leaf = torch.autograd.grad(value, leaves, retain_graph=True, allow_unused=True)
            for gradient, slope in zip(by_leaf, slopes, strict=False):
                if gradient is not None:
                    derivatives[:, column] += slope @ np.atleast_1d(gradient.numpy())
        return values, derivatives

    def point_motion(
        self,
        displacement: np.ndarray,
        dilation: float | np.ndarray | None = None,
        differentiable: bool = False,
    ) -> PointMotion:
        """The motion at the wall's points, for fields instead of averages; displacement and
        dilation as for `values`."""
        gradient = self.wall.gradients(displacement).swapaxes(1, 2)
        parts = [torch.as_tensor(self.wall.values(displacement))]
        parts.append(torch.as_tensor(np.eye(3) + gradient))
        if isinstance(dilation, np.ndarray):
            parts.append(torch.as_tensor(self.wall.corner_values(dilation[..., None])[:, 0]))
        parts += [self._place.clone(), self._depth_gradient.clone()]
        for part in parts:
            part.requires_grad_(differentiable)
        u, F, *varying, place, depth_gradient = parts
        allowed = varying[0] if varying else dilation
        return PointMotion(place, u, F, allowed, depth_gradient, self.measure, self._unloaded_share)

    def _unloaded_slopes(self, axis_gradient, nodes: "NodeMoves", k: int) -> list[np.ndarray]:
        """Derivatives of the unloaded length (k, 1) and the segments' volumes (k, 17)."""
        length, volumes = np.zeros((k, 1)), np.zeros((k, len(SEGMENTS)))
        at_cavity = nodes.moves[:, self.cavity.nodes]
        length[nodes.which, 0] = np.einsum("nx,knx->k", axis_gradient, at_cavity)
        whole = self._whole @ nodes.spreading
        volumes[nodes.which] = (self.wall.segment_volumes[:, None] * whole).T
        return [length, volumes]

    def _mean_slopes(
        self, point, densities, moves, dilation_moves, nodes: "NodeMoves | None"
    ) -> list[np.ndarray]:
        """Derivatives (k, 17) of the segments' means of each density, along the moves."""
        k, n = moves.shape[:2]
        side_by_side = np.ascontiguousarray(moves.transpose(1, 0, 2).reshape(n, 3 * k))
        leaves = [point.displacement, point.deformation_gradient]
        # (M, k, c) of the displacement, of F row by row, and of the dilation.
        changes = [
            lambda: self.wall.values(side_by_side).reshape(-1, k, 3),
            lambda: self.wall.gradients(side_by_side).reshape(-1, 3, k, 3).transpose(0, 2, 3, 1),
        ]
        if isinstance(point.dilation, torch.Tensor):
            leaves.append(point.dilation)
            changes.append(
                lambda: self.wall.corner_values(np.moveaxis(dilation_moves, 0, -1))[..., None]
            )
        if nodes is not None:
            # The displacement stays, its gradient follows the nodes: d(du/dx) = -du/dx dV/dx.
            stretch = point.deformation_gradient.detach().numpy() - np.eye(3)
            depth, of_motion = self.wall.depth_gradient, changes[1]

            def placed(values):
                """(M, k, ...) of values for the moves that move nodes."""
                found = np.zeros((len(values), k, *values.shape[2:]))
                found[:, nodes.which] = values
                return found

            following = np.matmul(stretch[:, None], nodes.gradients.swapaxes(2, 3))
            changes[1] = lambda: of_motion() - placed(following)
            leaves += [point.place, point.depth_gradient]
            changes.append(lambda: placed(nodes.places))
            changes.append(
                lambda: -placed(np.matmul(nodes.gradients, depth[:, None, :, None])[..., 0])
            )
        made: dict[int, np.ndarray] = {}
        slopes = []
        for density, shares in densities.values():
            by_leaf = torch.autograd.grad(
                density.sum(), leaves, retain_graph=True, allow_unused=True
            )
            total = np.zeros((len(density), k))
            for i, gradient in enumerate(by_leaf):
                if gradient is None:
                    continue
                if i not in made:
                    made[i] = np.ascontiguousarray(changes[i]().reshape(len(density), k, -1))
                flat = gradient.numpy().reshape(len(density), -1, 1)
                total += np.matmul(made[i], flat)[..., 0]
            along = shares @ total
            if nodes is not None:
                value, spreading = density.detach().numpy(), nodes.spreading
                along[:, nodes.which] += shares @ (value[:, None] * spreading)
                along[:, nodes.which] -= (shares @ value)[:, None] * (shares @ spreading)
            slopes.append(along.T)
        return slopes

    def _long_axis(self, displacement) -> tuple[tuple[float, float], np.ndarray]:
        """Loaded and unloaded length (mm) from the mean height of the base's endocardial ring to
        the endocardial apex, and the gradient (m, 3) of the loaded one about the cavity's nodes."""
        cavity = self.cavity
        z, moved = cavity.reference[:, 2], displacement[cavity.nodes, 2]
        gradient = np.zeros_like(cavity.reference)
        gradient[cavity.ring, 2] += 1 / len(cavity.ring)
        gradient[cavity.apex, 2] -= 1
        unloaded = z[cavity.ring].mean() - z[cavity.apex]
        return (float(unloaded + gradient[:, 2] @ moved), float(unloaded)), gradient


class NodeMoves:
    """Moves (k, n, 3) of the unloaded nodes: `which` of them move any, and of those K the `moves`
    (K, n, 3), `places` (M, K, 3), `gradients` (M, K, 3, 3), d(move)/dx with x first, and
    `spreading` (M, K), the relative change of the volume that each point stands for."""

    def __init__(self, wall: Wall, moves: np.ndarray):
        self.which = np.flatnonzero(moves.any(axis=(1, 2)))
        self.moves = moves[self.which]
        beside = np.ascontiguousarray(self.moves.transpose(1, 0, 2).reshape(moves.shape[1], -1))
        count = len(self.which)
        self.places = wall.values(beside).reshape(-1, count, 3)
        gradients = wall.gradients(beside).reshape(-1, 3, count, 3)
        self.gradients = gradients.swapaxes(1, 2)
        self.spreading = np.trace(self.gradients, axis1=2, axis2=3)


def level_shares(volumes: torch.Tensor) -> dict[str, torch.Tensor]:
    """Level -> weights (17,) that make the mean over a level's wall of means over segments, which
    have `volumes` (17,)."""
    found = {}
    for level, numbers in LEVELS.items():
        mine = torch.zeros(len(SEGMENTS), dtype=volumes.dtype)
        mine[[number - 1 for number in numbers]] = 1.0
        found[level] = mine * volumes / (mine @ volumes)
    return found
