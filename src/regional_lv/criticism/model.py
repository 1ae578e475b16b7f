"""Parameters of one or several hearts, what they predict, and how likely that makes the data.

All models here share one form. Coordinates x (P) are, in this order: what moves theta, one psi per
extension on the scale of its hypothesis, and one log noise scale per quantity whose noise is
inferred. log theta of heart s is `offset[s] + moves[s] @ x[:, :Q]`: the identity for one heart; a
block each for several; a column for each factor of the material law, over all zones, for hearts of
known theta on a material whose reference values are known up to these factors.
"""

from dataclasses import dataclass

import numpy as np
import torch

from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.observations import Observations
from regional_lv.errors import InputError
from regional_lv.inference.point import LOG_SIGMA_BOUNDS
from regional_lv.parameters import Parameterisation

CHUNK = 1024
SMALLEST_SHIFT = 0.1
"""Room that common factors of known thetas need on either side, in log theta."""


@dataclass(frozen=True)
class Layout:
    """Where log theta of each heart comes from: offset (S, P), moves (S, P, Q), names (Q), low
    and high (Q,), and whether the coordinates are log theta with a prior uniform in theta."""

    parameters: Parameterisation
    offset: torch.Tensor
    moves: torch.Tensor
    names: tuple[str, ...]
    low: torch.Tensor
    high: torch.Tensor
    uniform_in_theta: bool

    @classmethod
    def inferred(cls, subjects: tuple[str, ...], parameters: Parameterisation) -> "Layout":
        """All parameters unknown in every heart, uniform on their box."""
        count, p = len(subjects), len(parameters)
        moves = torch.eye(count * p, dtype=torch.float64).reshape(count, p, count * p)
        prefix = [""] if count == 1 else [f"{name}: " for name in subjects]
        names = tuple(f"{s}{name}" for s in prefix for name in parameters.names)
        low, high = (
            torch.as_tensor(np.log(np.tile(bound, count)))
            for bound in (parameters.lower, parameters.upper)
        )
        return cls(parameters, torch.zeros(count, p).double(), moves, names, low, high, True)

    @classmethod
    def known(cls, theta: torch.Tensor, parameters: Parameterisation) -> "Layout":
        """Known thetas (S, P), up to a common number for each factor of the material law.

        Their prior is uniform in the logarithm, over all that keeps every heart inside the box.
        Raises InputError if that leaves no room.
        """
        offset = theta.log()
        masks = [torch.as_tensor(parameters.of_factor(name)) for name in parameters.factors]
        moves = torch.stack(masks, dim=-1).double().expand(len(theta), -1, -1)
        lowest = torch.as_tensor(np.log(parameters.lower)) - offset
        highest = torch.as_tensor(np.log(parameters.upper)) - offset
        low = torch.stack([lowest[:, mask].max() for mask in masks])
        high = torch.stack([highest[:, mask].min() for mask in masks])
        if torch.minimum(high, -low).min() < SMALLEST_SHIFT:
            raise InputError(
                "criticism.joint: the known thetas reach the bounds of the emulator's box, which "
                "leaves no room for common factors on the reference material; take subjects nearer "
                "to its middle, or widen design.lower and design.upper (parameters.bounds)"
            )
        names = tuple(f"log factor {name}" for name in parameters.factors)
        return cls(parameters, offset, moves, names, low, high, False)


class Model:
    """Observations under an extended emulator, with a Gaussian or a Student-t noise.

    discrepancy: covariance (S, D, D) that is added to the emulator's own.
    tails: the noise is Student's t with the known sd as its scale; one more coordinate, 1 / nu,
    comes after the psi.
    The emulator's covariance is taken where `settle` says and kept there while parameters move:
    estimates are not drawn to where the emulator is least certain.
    """

    def __init__(
        self,
        observations: Observations,
        emulator: ExtendedEmulator,
        layout: Layout,
        tails=None,
        discrepancy: torch.Tensor | None = None,
    ):
        self.observations, self.emulator, self.layout = observations, emulator, layout
        self.tails, self.discrepancy = tails, discrepancy
        hypotheses = [e.hypothesis for e in emulator.extensions] + ([tails] if tails else [])
        q, groups = len(layout.names), observations.noise.groups
        self.psi = slice(q, q + len(emulator.extensions))
        self.tail = q + len(emulator.extensions) if tails else None
        self.means = self.psi.stop
        self.first_sigma = q + len(hypotheses)
        self.names = (
            *layout.names,
            *(h.name for h in hypotheses),
            *(f"log_sigma_{quantity}" for quantity in groups),
        )
        self.low, self.high = (
            torch.cat([edge, torch.tensor([*values, *[bound] * len(groups)], dtype=torch.float64)])
            for edge, values, bound in (
                (layout.low, [h.scale(h.low) for h in hypotheses], LOG_SIGMA_BOUNDS[0]),
                (layout.high, [h.scale(h.high) for h in hypotheses], LOG_SIGMA_BOUNDS[1]),
            )
        )
        s, d = observations.y.shape
        self.error = torch.zeros(s, d, d, dtype=torch.float64)

    def apart(self) -> list["Model"]:
        """A model for each heart by itself."""
        return [
            Model(one, self.emulator, Layout.inferred(one.subjects, self.layout.parameters))
            for one in self.observations.apart()
        ]

    # ---------------------------------------------------------------------------- coordinates

    def theta(self, x: torch.Tensor) -> torch.Tensor:
        """(..., S, P)."""
        moved = (self.layout.moves @ x[..., None, : len(self.layout.names), None])[..., 0]
        return torch.exp(self.layout.offset + moved)

    def scaled_psi(self, x: torch.Tensor) -> torch.Tensor:
        """(..., S, k) on the scales of the hypotheses: the same for all hearts."""
        psi = x[..., None, self.psi]
        return psi.expand(*x.shape[:-1], len(self.layout.offset), psi.shape[-1])

    def psi_of(self, x: torch.Tensor) -> torch.Tensor:
        """(..., S, k) in the units of the hypotheses."""
        scaled = self.scaled_psi(x).clone()
        for i, extension in enumerate(self.emulator.extensions):
            scaled[..., i] = extension.hypothesis.scale.inverse(scaled[..., i])
        return scaled

    # ----------------------------------------------------------------------------- prediction

    def mean(self, x: torch.Tensor) -> torch.Tensor:
        """(M, S, D) at x (M, P)."""
        parts = [
            self.emulator.mean(self.theta(part), self.scaled_psi(part))
            for part in x.split(self._rows)
        ]
        return torch.cat(parts)

    def linearise(
        self, x: torch.Tensor, active: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (M, S, D) and its derivatives (M, S, D, R) about the first R = `means`
        coordinates.

        active: (M, k), which extensions are free in each row; the others stay at their base value.
        """
        rows = torch.arange(len(x)).split(self._rows)
        parts = [self._linearise(x[at], None if active is None else active[at]) for at in rows]
        return tuple(torch.cat(column) for column in zip(*parts, strict=True))

    def _linearise(self, x, active):
        theta = self.theta(x)
        if active is not None:
            active = active[:, None, :].expand(len(x), theta.shape[1], -1)
        mean, by_log_theta, by_psi = self.emulator.linearise(theta, self.scaled_psi(x), active)
        return mean, torch.cat([by_log_theta @ self.layout.moves, by_psi], dim=-1)

    def at_base(self, x: torch.Tensor) -> torch.Tensor:
        """Coordinates (M, P) of this model from those (M, P - k) of the model without its
        extensions, with every psi at its base value."""
        base = [e.hypothesis.scale(e.hypothesis.base) for e in self.emulator.extensions]
        psi = torch.tensor(base, dtype=x.dtype).expand(len(x), -1)
        return torch.cat([x[:, : self.psi.start], psi, x[:, self.psi.start :]], dim=1)

    @property
    def _rows(self) -> int:
        return max(1, CHUNK // len(self.layout.offset))

    def signature(self, extension, x: torch.Tensor) -> torch.Tensor:
        """d(outputs)/d(scaled psi) (M, S, D) of one more extension at its base."""
        parts = [
            self.emulator.signature(extension, self.theta(part), self.scaled_psi(part))
            for part in x.split(self._rows)
        ]
        return torch.cat(parts)

    # ------------------------------------------------------------------------------ covariance

    def settle(self, x: torch.Tensor) -> "Model":
        """Take the emulator's covariance at x (P); return self."""
        with torch.no_grad():
            error = self.emulator.predict(self.theta(x), self.scaled_psi(x)).covariance
        both = self.observations.present[:, :, None] & self.observations.present[:, None, :]
        self.error = torch.where(both, error, 0.0)
        if self.discrepancy is not None:
            self.error = self.error + self.discrepancy
        return self

    def noise_variance(self, x: torch.Tensor) -> torch.Tensor:
        """(M, S, D) at x (M, P); (1, S, D) if all of it is known. 1 where nothing was observed."""
        noise = self.observations.noise
        log_sigma = x[:, None, self.first_sigma :] if noise.groups else x.new_zeros(1, 1, 0)
        return torch.where(self.observations.present, noise.variance(log_sigma), 1.0)

    def covariance(self, x: torch.Tensor) -> torch.Tensor:
        """(M or 1, S, D, D) of what was observed; unit rows where nothing was."""
        return self.error + torch.diag_embed(self.noise_variance(x))

    def whitening(self, x: torch.Tensor, mask: torch.Tensor | None = None) -> torch.Tensor:
        """W (M or 1, S, D, D) with W S W' = I on the channels in `mask` (..., S, D) that were
        observed, zero elsewhere; its diagonal's logarithms sum to -1/2 log det."""
        mask = self.observations.present if mask is None else mask & self.observations.present
        both = mask[..., :, None] & mask[..., None, :]
        covariance = torch.where(both, self.covariance(x), 0.0)
        covariance = covariance + torch.diag_embed((~mask).double())
        factor = torch.linalg.cholesky(covariance)
        identity = torch.eye(factor.shape[-1], dtype=factor.dtype)
        inverse = torch.linalg.solve_triangular(factor, identity.expand_as(factor), upper=False)
        return torch.where(both, inverse, 0.0)

    # ----------------------------------------------------------------------------------- prior

    def log_prior(self, x: torch.Tensor) -> torch.Tensor:
        """Log density (M,) in the coordinates x, normalised over the box."""
        q = len(self.layout.names)
        width = self.high - self.low
        total = x.new_zeros(x.shape[:-1]) - width[q : self.first_sigma].log().sum()
        if self.layout.uniform_in_theta:
            edges = self.high[:q].exp() - self.low[:q].exp()
            total = total + (x[..., :q] - edges.log()).sum(-1)
        else:
            total = total - width[:q].log().sum()
        if self.first_sigma < x.shape[-1]:
            log_sigma = x[..., self.first_sigma :]
            total = total + self.observations.noise.log_prior(log_sigma)
            total = total + log_sigma.sum(-1)  # the Jacobian of exp
        return total

    @property
    def prior_precision(self) -> torch.Tensor:
        """(R,): weak, as of a normal distribution with the sd of a uniform one on the range."""
        return 12 / (self.high - self.low)[: self.means].square()
