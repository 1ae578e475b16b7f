"""Covariances of values and derivatives of a process with a `BlockRQKernel`, any of them seen.

Inputs are in units of their length scales, u. Of n points all values are seen, and M derivatives:
number a is that about the input `along[a]` at the point `at[a]`. With gaps g_p = u_p - u'_p, the
bases 1 + r_b^2 / (2 alpha) and the block b(p) of input p

    cov(f, df'/du_p)      = k g_p / base_b(p),
    cov(df/du_p, df'/du_q) = k ([p = q] / base - g_p g_q / (base base) (1 + [b(p) = b(q)] / alpha))

(Rasmussen and Williams 2006, section 9.4, ISBN 026218253X).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch

from regional_lv.emulators.kernels import BlockRQKernel

ROWS_AT_ONCE = 1000
"""Of the covariance of the derivatives."""

POINTS_AT_ONCE = 16
"""Whose derivatives are made together: their parts stay in the processor's cache."""


@dataclass(frozen=True)
class ObservedDerivatives:
    """Derivatives that are seen: points `at` (M,) and inputs `along` (M,)."""

    at: torch.Tensor
    along: torch.Tensor

    @classmethod
    def some(
        cls, points: int, inputs: int, most: int, seed: int, weight: torch.Tensor | None = None
    ) -> "ObservedDerivatives":
        """At most `most` of all derivatives, input by input: as many at every point, or one more,
        chosen at random with probabilities as `weight` (P,), all alike by default (Efraimidis and
        Spirakis 2006, doi 10.1016/j.ipl.2005.11.003)."""
        generator = torch.Generator().manual_seed(seed)
        each, more = divmod(min(max(most, 0), points * inputs), points)
        count = torch.full((points,), each)
        count[torch.randperm(points, generator=generator)[:more]] += 1
        late = -torch.rand(points, inputs, generator=generator).log()
        order = (late if weight is None else late / weight).argsort(1).argsort(1)
        along, at = (order < count[:, None]).T.nonzero(as_tuple=True)
        return cls(at, along)

    @classmethod
    def of_all(cls, points: torch.Tensor, inputs: torch.Tensor) -> "ObservedDerivatives":
        """All derivatives with respect to some `inputs` (k,) at these `points` (m,)."""
        return cls(points.repeat(len(inputs)), inputs.repeat_interleave(len(points)))

    def joined(self, other: "ObservedDerivatives") -> "ObservedDerivatives":
        """These, then the others."""
        return ObservedDerivatives(
            torch.cat([self.at, other.at]), torch.cat([self.along, other.along])
        )

    def __len__(self) -> int:
        return len(self.at)


def block_numbers(blocks: Sequence[slice]) -> torch.Tensor:
    """Number (P,) of each input's block."""
    return torch.cat([torch.full((b.stop - b.start,), i) for i, b in enumerate(blocks)])


def covariance(kernel: BlockRQKernel, x: torch.Tensor, seen: ObservedDerivatives) -> torch.Tensor:
    """Covariance (n + M, n + M) of the values at x (n, P) and the derivatives with respect to u."""
    bases = torch.stack(kernel.bases(x, x))
    k, inverse = kernel.of_bases(list(bases)), 1 / bases
    u, block = x / kernel.lengthscale[0], block_numbers(kernel.blocks)
    at, along = seen.at, seen.along
    # (n, M): the derivative of log k with respect to the second point, along what is seen there.
    slope = (u[:, along] - u[at, along]) * inverse[block[along], :, at].T
    crossed = k[:, at] * slope
    between = slope[at]
    n = len(x)
    # Filled part by part: no second matrix of this size is made.
    matrix = k.new_empty(n + len(at), n + len(at))
    matrix[:n, :n], matrix[:n, n:], matrix[n:, :n] = k, crossed, crossed.T
    for part in torch.arange(len(at)).split(ROWS_AT_ONCE):
        here, mine = at[part], along[part]
        product = between[part] * between[:, part].T
        product = product * (1 + (block[mine][:, None] == block[along]) / kernel.alpha)
        twice = (mine[:, None] == along) * inverse[block[mine], here][:, at]
        matrix[n + part, n:] = k[here][:, at] * (product + twice)
    return matrix


def crossed(
    kernel: BlockRQKernel, x: torch.Tensor, y: torch.Tensor, seen: ObservedDerivatives
) -> torch.Tensor:
    """Covariance (m, n + M) of the values at x (m, P) with what is seen at y (n, P)."""
    bases = torch.stack(kernel.bases(x, y))
    k, scale = kernel.of_bases(list(bases)), kernel.lengthscale[0]
    block, along = block_numbers(kernel.blocks)[seen.along], seen.along
    gap = (x / scale)[:, along] - (y / scale)[seen.at, along]
    return torch.cat([k, k[:, seen.at] * gap / bases[block, :, seen.at].T], 1)


class Weighted:
    """What is seen at y (n, P), times weights (n + M, D): a mean, and its derivatives.

    For every point all weights on derivatives are summed simulation by simulation first, so that
    derivatives of the mean cost no more for each derivative that is seen.

    fixed: values (P,) of all inputs, and a mask (P,) of those which are the same at all points that
    are asked for; they cost nothing then. What they add to the distance from a simulation is one
    more coordinate of their block, and what they make of its weights is known.
    """

    def __init__(
        self,
        kernel: BlockRQKernel,
        y: torch.Tensor,
        seen: ObservedDerivatives,
        weights: torch.Tensor,
        fixed: tuple[torch.Tensor, torch.Tensor] | None = None,
    ):
        n, p = y.shape
        self.scale = kernel.lengthscale[0].detach()
        self.alpha = kernel.alpha.detach()
        self.of_values = weights[:n]
        dense = weights.new_zeros(p, n, weights.shape[1])
        # What is seen twice has the sum of its weights.
        dense.index_put_((seen.along, seen.at), weights[n:], accumulate=True)
        u = y / self.scale
        at, still = (u.new_zeros(p), torch.zeros(p, dtype=torch.bool)) if fixed is None else fixed
        self._columns: list[torch.Tensor] = []  # of y, by block
        # By block, the weights on derivatives and what they make at home, both ways round:
        # (1 + p, n D) and (n, (1 + p) D).
        self._towards: list[torch.Tensor] = []
        self._side_by_side: list[torch.Tensor] = []
        self._free: list[torch.Tensor] = []
        for block in kernel.blocks:
            own = torch.arange(block.start, block.stop)
            free, rest = own[~still[own]], own[still[own]]
            home = (u.T[free, :, None] * dense[free]).sum(0)
            columns = u[:, free]
            if len(rest):
                gap = at[rest] / self.scale[rest] - u[:, rest]
                home = home - (gap.T[..., None] * dense[rest]).sum(0)
                columns = torch.cat([columns, gap.norm(dim=1, keepdim=True)], 1)
            self._free.append(free)
            self._columns.append(columns)
            both = torch.cat([dense[free], -home[None]])
            self._towards.append(both.flatten(1))
            self._side_by_side.append(both.transpose(0, 1).reshape(n, -1))
        widths = [columns.shape[1] for columns in self._columns]
        ends = torch.tensor([0, *widths]).cumsum(0).tolist()
        self._kernel = BlockRQKernel([slice(*pair) for pair in pairwise(ends)]).double()
        self._kernel.initialize(lengthscale=1.0)
        self._kernel.alpha = self.alpha
        self._kernel.requires_grad_(False)
        self.y = torch.cat(self._columns, 1)

    def _reduced(self, x) -> list[torch.Tensor]:
        """Coordinates (m, p) of x (m, P) in length scales, by block, without fixed ones."""
        u = x / self.scale
        return [u[:, free] for free in self._free]

    def _bases(self, u):
        """Of the kernel, at reduced coordinates."""
        widened = [
            torch.nn.functional.pad(part, (0, columns.shape[1] - part.shape[1]))
            for part, columns in zip(u, self._columns, strict=True)
        ]
        return self._kernel.bases(torch.cat(widened, 1), self.y)

    def mean(self, x: torch.Tensor) -> torch.Tensor:
        """(m, D) at x (m, P)."""
        u = self._reduced(x)
        bases = self._bases(u)
        k = self._kernel.of_bases(bases)
        total = k @ self.of_values
        for part, base, weights in zip(u, bases, self._side_by_side, strict=True):
            found = ((k / base) @ weights).reshape(len(x), -1, total.shape[1])
            total = total + (part[..., None] * found[:, :-1]).sum(1) + found[:, -1]
        return total

    def with_slopes(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """`mean`, and its derivatives (m, D, P) with respect to x, 0 for what is fixed."""
        u = self._reduced(x)
        bases = self._bases(u)
        k, inverse = self._kernel.of_bases(bases), [1 / base for base in bases]
        mean = x.new_empty(len(x), self.of_values.shape[1])
        found = x.new_zeros(*x.shape, mean.shape[1])
        for free, rate, weights in zip(self._free, inverse, self._side_by_side, strict=True):
            own = ((k * rate) @ weights).reshape(len(x), len(free) + 1, mean.shape[1])
            found[:, free] = own[:, :-1]
        for first in range(0, len(x), POINTS_AT_ONCE):
            some = slice(first, first + POINTS_AT_ONCE)
            here = k[some], [part[some] for part in u], [rate[some] for rate in inverse]
            mean[some] = self._subtract_far(*here, found[some])
        return mean, found.mT / self.scale

    def _subtract_far(self, k, u, inverse, found) -> torch.Tensor:
        """Of the slopes `found` (m, P, D), what the kernel's make of the weights; the mean
        (m, D)."""
        towards, total = [], self.of_values.repeat(len(k), 1, 1)
        for part, rate, weights in zip(u, inverse, self._towards, strict=True):
            toward = torch.nn.functional.pad(part, (0, 1), value=1.0) @ weights
            towards.append(toward.reshape(total.shape))
            total.addcmul_(rate[..., None], towards[-1])
        gaps = [
            (k * rate)[:, None] * (part[..., None] - columns.T[: part.shape[1]])
            for part, rate, columns in zip(u, inverse, self._columns, strict=True)
        ]
        far = torch.cat(gaps, 1).bmm(total).split([gap.shape[1] for gap in gaps], 1)
        blocks = zip(self._free, far, gaps, inverse, towards, strict=True)
        for free, of_block, gap, rate, toward in blocks:
            of_block.baddbmm_(gap * (rate / self.alpha)[:, None], toward)
            found[:, free] -= of_block
        return (k[:, None] @ total)[:, 0]
