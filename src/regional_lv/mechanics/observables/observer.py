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
from regional_lv.mechanics.observables.wall import Cavity, Shares, Wall

WHOLE = ((0.0, 1.0), 0.0)
"""Layer and rotation of the segments that leave nothing out."""


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
        self._whole = self._sampled = self.wall.shares(*WHOLE)
        self._window = WHOLE
        self._place = torch.as_tensor(self.wall.place)
        self._depth_gradient = torch.as_tensor(self.wall.depth_gradient)
        self._configure(observed)

    def with_settings(self, observed: Mapping) -> "Observer":
        """An observer of the same wall with other `observed`: it costs next to nothing."""
        other = copy.copy(self)
        other._configure(observed)
        return other

    def _configure(self, observed: Mapping) -> None:
        self.measure = StrainMeasure.of(observed)
        self._unloaded_share = observed["unloaded_share"]
        asked = tuple(observed["layer"]), observed["segment_rotation_deg"]
        if asked != self._window:
            self._window = asked
            self._sampled = self._whole if asked == WHOLE else self.wall.shares(*asked)
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
        perturbed: Mapping[int, Sequence[tuple["Observer", float]]] | None = None,
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """As `values`, and if there are `moves`, the values' derivatives (k, D) along these.

        moves: (k, n, 3) changes of the displacement, dilation_moves (k, cells, 8) those of the
        dilation and node_moves (k, n, 3) those of the unloaded nodes that go with them. perturbed:
        of some moves, observers of the same wall (`with_settings`) with weights: a difference of
        what they see is added. Derivatives are exact: those of the values that are returned. Of
        moving nodes they take the angles about the axis, which turned segments depend on, as fixed.
        """
        kinds: dict = {}
        for at, channel in enumerate(channels):
            kinds.setdefault(channel.kind, []).append((at, channel.place))
        order = [at for asked in kinds.values() for at, _ in asked]
        point = self.point_motion(displacement, dilation, moves is not None)
        with torch.set_grad_enabled(moves is not None):
            densities = self._densities(kinds, point)
        cavity, cavity_gradient = self.cavity.volume_and_gradient(displacement[self.cavity.nodes])
        lengths, axis_gradient = self._long_axis(displacement)
        rest = [torch.tensor(each, dtype=torch.float64) for each in (cavity, *lengths)]
        rest.append(torch.tensor(self.wall.segment_volumes))
        means = self._means(densities)
        leaves = [*means.values(), *rest]
        for leaf in leaves:
            leaf.requires_grad_(moves is not None)
        found = self._channel_values(kinds, means, rest)
        values = np.empty(len(order))
        values[order] = found.detach().numpy()
        if moves is None:
            return values, None
        carried = moves if node_moves is None else moves + node_moves
        slopes = [
            *self._mean_slopes(point, densities, moves, dilation_moves, node_moves),
            np.einsum("mx,kmx->k", cavity_gradient, carried[:, self.cavity.nodes])[:, None],
            np.einsum("nx,knx->k", axis_gradient, carried[:, self.cavity.nodes])[:, None],
        ]
        if node_moves is not None:
            slopes += self._unloaded_slopes(axis_gradient, node_moves)
        each = torch.eye(len(found), dtype=found.dtype)
        by_leaf = torch.autograd.grad(found, leaves, each, is_grads_batched=True, allow_unused=True)
        along = np.zeros((len(moves), len(order)))
        for gradient, slope in zip(by_leaf, slopes, strict=False):
            if gradient is not None:
                along += slope @ gradient.numpy().reshape(len(order), -1).T
        for k, sides in (perturbed or {}).items():
            for other, weight in sides:
                seen = other._means(other._densities_under(kinds, point, self, densities))
                change = other._channel_values(kinds, seen, rest) - found
                along[k] += weight * change.detach().numpy()
        derivatives = np.empty_like(along)
        derivatives[:, order] = along
        return values, derivatives

    def _densities(self, kinds, point: PointMotion) -> dict:
        """What is averaged, name -> (density (M,), shares (17, M))."""
        return {
            name: (density, self._sampled if kind.is_strain else self._whole)
            for kind in kinds
            for name, density in kind().densities(point).items()
        }

    def _densities_under(
        self, kinds, point: PointMotion, other: "Observer", densities: dict
    ) -> dict:
        """As `_densities`, of a motion of which another observer's are known."""
        mine, others = ((o.measure, o._unloaded_share) for o in (self, other))
        if mine != others:
            with torch.no_grad():
                return self._densities(kinds, point.measured(*mine))
        strains = {kind.name for kind in kinds if kind.is_strain}
        return {
            name: (density, self._sampled if name in strains else shares)
            for name, (density, shares) in densities.items()
        }

    def _means(self, densities: dict) -> dict[str, torch.Tensor]:
        """Averages (17,) of densities over the segments, by name."""
        return {
            name: torch.tensor(shares @ density.detach().numpy())
            for name, (density, shares) in densities.items()
        }

    def _channel_values(self, kinds, means, rest) -> torch.Tensor:
        """Values of the channels, kind by kind, from the means, and from the cavity's volume, the
        two lengths of the long axis and the segments' volumes."""
        cavity, loaded, unloaded, volumes = rest
        motion = Motion(means, level_shares(volumes), cavity, (loaded, unloaded))
        return torch.cat(
            [
                self._scale.get(kind.name, 1.0) * kind().values(motion, [p for _, p in asked])
                for kind, asked in kinds.items()
            ]
        )

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

    def _unloaded_slopes(self, axis_gradient, node_moves: np.ndarray) -> list[np.ndarray]:
        """Derivatives of the unloaded length (k, 1) and the segments' volumes (k, 17)."""
        at_cavity = node_moves[:, self.cavity.nodes]
        length = np.einsum("nx,knx->k", axis_gradient, at_cavity)[:, None]
        return [
            length,
            _along(self._spreading(self._whole), node_moves) * self.wall.segment_volumes,
        ]

    def _spreading(self, shares: Shares) -> np.ndarray:
        """Derivatives (17, n, 3), with respect to the nodes' places, of the logarithm of the volume
        that points stand for, averaged."""
        every = np.broadcast_to(np.eye(3), (len(self.wall.volume), 3, 3))
        return self.wall.on_nodes(shares, None, every)

    def _mean_slopes(self, point, densities, moves, dilation_moves, node_moves) -> list[np.ndarray]:
        """Derivatives (k, 17) of the segments' means of each density, along the moves.

        What a mean changes with is brought to the nodes first, so that each move is one product.
        """
        leaves = [point.displacement, point.deformation_gradient, point.place, point.depth_gradient]
        if isinstance(point.dilation, torch.Tensor):
            leaves.append(point.dilation)
        spreading = {}
        if node_moves is not None:
            every = {id(shares): shares for _, shares in densities.values()}
            spreading = {number: self._spreading(shares) for number, shares in every.items()}
        slopes = []
        for density, shares in densities.values():
            by_leaf = torch.autograd.grad(
                density.sum(), leaves, retain_graph=True, allow_unused=True
            )
            by_u, by_F, by_place, by_depth, *by_dilation = (
                np.zeros(leaf.shape) if gradient is None else gradient.numpy()
                for leaf, gradient in zip(leaves, by_leaf, strict=True)
            )
            slope = _along(self.wall.on_nodes(shares, by_u, by_F), moves)
            if by_dilation:
                on_corners = self.wall.on_corners(shares, by_dilation[0])
                slope += _along(on_corners, dilation_moves)
            if node_moves is not None:
                # The displacement stays, its gradient follows the nodes, d(du/dx) = -du/dx dV/dx,
                # as the depth's does, and points stand for more or less of the wall.
                stretch = point.deformation_gradient.detach().numpy() - np.eye(3)
                value = density.detach().numpy()
                following = value[:, None, None] * np.eye(3)
                following -= stretch.swapaxes(1, 2) @ by_F
                following -= self.wall.depth_gradient[:, :, None] * by_depth[:, None]
                on_nodes = self.wall.on_nodes(shares, by_place, following)
                on_nodes -= (shares @ value)[:, None, None] * spreading[id(shares)]
                slope += _along(on_nodes, node_moves)
            slopes.append(slope)
        return slopes

    def _long_axis(self, displacement) -> tuple[tuple[float, float], np.ndarray]:
        """Loaded and unloaded length (mm) from the mean height of the base's endocardial ring to
        the endocardial apex, and the gradient (m, 3) of the loaded one with respect to the cavity's
        nodes."""
        cavity = self.cavity
        z, moved = cavity.reference[:, 2], displacement[cavity.nodes, 2]
        gradient = np.zeros_like(cavity.reference)
        gradient[cavity.ring, 2] += 1 / len(cavity.ring)
        gradient[cavity.apex, 2] -= 1
        unloaded = z[cavity.ring].mean() - z[cavity.apex]
        return (float(unloaded + gradient[:, 2] @ moved), float(unloaded)), gradient


def _along(gradients: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Products (k, 17) of gradients (17, ...) with moves (k, ...)."""
    return moves.reshape(len(moves), -1) @ gradients.reshape(len(gradients), -1).T


def level_shares(volumes: torch.Tensor) -> dict[str, torch.Tensor]:
    """Level -> weights (17,) that make the mean over a level's wall of means over segments, which
    have `volumes` (17,)."""
    found = {}
    for level, numbers in LEVELS.items():
        mine = torch.zeros(len(SEGMENTS), dtype=volumes.dtype)
        mine[[number - 1 for number in numbers]] = 1.0
        found[level] = mine * volumes / (mine @ volumes)
    return found
