"""The motion of the wall as quantities see it: at its points, and averaged over its segments."""

import copy
from functools import cached_property

import torch

from regional_lv.mechanics.observables.strain_measure import StrainMeasure

DIRECTIONS = ("circumferential", "radial", "longitudinal")


class PointMotion:
    """Motion at M points of the wall; what is computed from it can be differentiated (torch).

    place (M, 3): the points in the unloaded state, mm. displacement (M, 3): mm.
    deformation_gradient (M, 3, 3): F. dilation (M,) or a number: the change of volume that the wall
    allows (its multiplier's, not the discrete det F), None if F is to be taken as it is.
    depth_gradient (M, 3): of the transmural coordinate. unloaded_share: of the strains along
    directions of the unloaded state.
    """

    def __init__(
        self,
        place,
        displacement,
        deformation_gradient,
        dilation,
        depth_gradient,
        measure,
        unloaded_share: float = 0.0,
    ):
        self.place, self.displacement = place, displacement
        self.deformation_gradient, self.dilation = deformation_gradient, dilation
        self.depth_gradient = depth_gradient
        self.measure: StrainMeasure = measure
        self._unloaded_share = unloaded_share

    def measured(self, measure: StrainMeasure, unloaded_share: float) -> "PointMotion":
        """The same motion with strains of another measure, or along other directions."""
        other = copy.copy(self)
        other.measure, other._unloaded_share = measure, unloaded_share
        vars(other).pop("strains", None)
        return other

    @cached_property
    def _adjugate(self) -> torch.Tensor:
        """det F times F^-1 (M, 3, 3)."""
        rows = self.deformation_gradient.unbind(1)
        columns = [torch.linalg.cross(rows[(i + 1) % 3], rows[(i + 2) % 3]) for i in range(3)]
        return torch.stack(columns, dim=-1)

    @cached_property
    def back(self) -> torch.Tensor:
        """F^-1 (M, 3, 3), which leads from the loaded to the unloaded state; with a dilation, that
        of a wall whose volume changes by it at every point.

        The discrete det F of a solution strays from it: with few elements through the wall they
        cannot thin as they should at each depth. How the wall stretches along its surfaces is not
        affected, so that the stretch along its normal is what is put right, from the other two.
        """
        adjugate = self._adjugate
        determinant = (self.deformation_gradient[:, 0] * adjugate[..., 0]).sum(-1)[:, None, None]
        inverse = adjugate / determinant
        if self.dilation is None:
            return inverse
        normal = self.directions[1]
        along = torch.einsum("mij,mj,mk->mik", inverse, normal, normal)
        wanted = self.dilation
        if isinstance(wanted, torch.Tensor):
            wanted = wanted[:, None, None]
        return inverse + (determinant / wanted - 1) * along

    @cached_property
    def _backward_stretch(self) -> torch.Tensor:
        """Right Cauchy-Green tensor (M, 3, 3) of the motion back."""
        return self.back.mT @ self.back

    @cached_property
    def directions(self) -> torch.Tensor:
        """Circumferential, radial and longitudinal unit vectors (3, M, 3) of the loaded state."""
        return local_directions(torch.einsum("mij,mi->mj", self._adjugate, self.depth_gradient))

    @cached_property
    def strains(self) -> dict[str, torch.Tensor]:
        """Strains (M,) by direction, of the motion from the loaded to the unloaded state."""
        C, share = self._backward_stretch, self._unloaded_share
        found = self.measure.along(C, self.directions)
        if share:
            unloaded = self.measure.along(C, self.unloaded_directions)
            found = (1 - share) * found + share * unloaded
        return dict(zip(DIRECTIONS, found, strict=True))

    @cached_property
    def unloaded_directions(self) -> torch.Tensor:
        """Where filling takes the circumferential, radial and longitudinal lines of the unloaded
        wall: unit vectors (3, M, 3) of the loaded state."""
        lines = torch.linalg.solve(self.back, local_directions(self.depth_gradient)[..., None])
        return torch.nn.functional.normalize(lines[..., 0], dim=-1)

    @cached_property
    def rotation(self) -> torch.Tensor:
        """Angle (M,) by which filling turns each point about the long axis, rad, counter-clockwise
        seen from the base."""
        x, y = self.place[:, 0], self.place[:, 1]
        there = self.place + self.displacement
        cross = x * there[:, 1] - y * there[:, 0]
        along = x * there[:, 0] + y * there[:, 1]
        return torch.atan2(cross, along)

    @cached_property
    def height(self) -> torch.Tensor:
        """Height z (M,) in the loaded state, mm."""
        return self.place[:, 2] + self.displacement[:, 2]


def local_directions(normal: torch.Tensor) -> torch.Tensor:
    """Circumferential, radial and longitudinal unit vectors (3, M, 3) from normals (M, 3).

    The radial direction is the normal of the surfaces of equal depth, pointing outwards; the
    circumferential one is horizontal and counter-clockwise seen from the base; the longitudinal
    one points to the base. Only where the normal is exactly vertical, a single point near the
    apex, is the circumferential direction not defined; the tiny number keeps it finite there.
    """
    radial = normal / normal.norm(dim=-1, keepdim=True)
    x, y = radial[:, 0], radial[:, 1]
    size = (x * x + y * y + 1e-16).sqrt()
    circumferential = torch.stack([-y / size, x / size, torch.zeros_like(x)], dim=-1)
    return torch.stack([circumferential, radial, torch.linalg.cross(radial, circumferential)])


class Motion:
    """What quantities are made of: means over segments and levels, the cavity, the long axis.

    `means` (17,) by name of what a quantity's `densities` gave; cavity_volume_ml; long_axis_mm,
    loaded and unloaded length; all torch numbers.
    """

    def __init__(self, means, level_shares, cavity_volume_ml, long_axis_mm):
        self._means, self._level_shares = means, level_shares
        self.cavity_volume_ml, self.long_axis_mm = cavity_volume_ml, long_axis_mm

    def segment_means(self, name: str) -> torch.Tensor:
        """Means (17,) over the segments of a density."""
        return self._means[name]

    def level_mean(self, name: str, level: str) -> torch.Tensor:
        """Mean of a density over the wall of a level (`aha.LEVELS`)."""
        return self._level_shares[level] @ self._means[name]
