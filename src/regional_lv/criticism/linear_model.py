"""A model that is linear about its fit: thousands of data sets are fitted without an emulator.

Errors are those of the emulator, of the measured inputs, which are integrated out, and the noise.
Parameters are the inferred inputs and the suspected ones that are free, within their ranges.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import torch

from regional_lv.criticism.patterns import hearts_of
from regional_lv.inference.evidence import WEAK, Fits, integrate
from regional_lv.inference.noise import LOG_SIGMA_BOUNDS, Noise
from regional_lv.inference.observed import Observed
from regional_lv.inference.optimise import maximise
from regional_lv.inference.potential import Potential
from regional_lv.inputs.closed_forms import HeavyTails
from regional_lv.inputs.space import Inputs

ITERATIONS, LEAST_GAIN = 60, 1e-10
"""Of the parameters' fit: its steps, and the gain of log density at which it ends."""

SCALE_STEPS, SETTLED = 12, 1e-3
"""Of the noise scales' fit: its steps, and the change of a logarithm at which it ends."""

LONGEST_STEP, LEAST_INFORMATION = 1.0, 0.5
"""Of the logarithm of a noise scale; and of the information about it, as a share of what is
expected."""

NUMBERS = 2e6
"""In the matrices (D x D) of the data sets that are fitted at once, at most: they stay in the
cache."""


@dataclass(frozen=True)
class LinearModel:
    """Outputs are mean + slopes d, d the change of the parameters from the fit in units of their
    ranges.

    y (D,): what was observed. mean (D,): measured inputs are as they were measured. by_input
    (D, K): derivatives with respect to the scaled coordinates of all inputs. error (1, D, D):
    covariance of all errors but the noise. x (P,): coordinates of the fit. free (K,): mask of the
    parameters. lower, upper (K,): ends of the ranges, scaled. log_sigma (G,): where fits of the
    noise start."""

    inputs: Inputs
    observed: Observed
    y: torch.Tensor
    mean: torch.Tensor
    by_input: torch.Tensor
    error: torch.Tensor
    noise: Noise
    x: torch.Tensor
    free: torch.Tensor
    lower: torch.Tensor
    upper: torch.Tensor
    log_sigma: torch.Tensor

    @classmethod
    def of(cls, potential: Potential, fitted: Fits) -> "LinearModel":
        """Of one fitted model (M = 1).

        Where its noise has heavy tails, the noise is taken as normal with the variance that the fit
        gives to each channel: the larger, the further off it is.
        """
        count, observed = len(potential.inputs), potential.observed
        mean, slopes = potential.linearise(fitted.x)
        error, noise = observed.dense(fitted.error), potential.noise
        known, free = fitted.x.clone(), fitted.free[0, :count].clone()
        if len(potential.measured):
            at = potential.measured.at
            known[:, at], free[at] = potential.measured.nominal, False
            columns = slopes[:, :, at]
            error = error + columns / potential.measured.precision(known)[:, None] @ columns.mT
        moved = (slopes @ (known - fitted.x)[:, :count, None])[..., 0]
        if potential.tails is not None:
            if free[potential.tails]:
                whitening = potential.whitening(fitted.x, fitted.error)
                weight = potential.weights(fitted.x, potential.y - mean, whitening)[0]
                error, noise = _weighted(error, noise, weight.rsqrt())
            free[potential.tails] = False
        model = cls(
            inputs=potential.inputs,
            observed=observed,
            y=potential.y,
            mean=(mean + moved)[0],
            by_input=slopes[0],
            error=error,
            noise=noise,
            x=fitted.x[0],
            free=free,
            lower=potential.low[:count],
            upper=potential.high[:count],
            log_sigma=fitted.x[0, count:],
        )
        return replace(model, log_sigma=model.fit(model.y[None]).log_sigma[0])

    @cached_property
    def width(self) -> torch.Tensor:
        """Of the ranges, (K,)."""
        return self.upper - self.lower

    @cached_property
    def slopes(self) -> torch.Tensor:
        """(D, n), about the parameters in units of their ranges."""
        return self.by_input[:, self.free] * self.width[self.free]

    @property
    def names(self) -> list[str]:
        """Of the parameters, (n,)."""
        return [name for name, free in zip(self.inputs.names, self.free, strict=True) if free]

    @property
    def doubted(self) -> tuple[int, ...]:
        """Places of the suspected inputs that are not free."""
        suspected = torch.as_tensor(self.inputs.of_role("suspected"))
        return tuple(torch.nonzero(suspected & ~self.free)[:, 0].tolist())

    @property
    def tails(self) -> int | None:
        """Place of `heavy_tails` among the inputs."""
        return next((k for k, one in enumerate(self.inputs) if isinstance(one, HeavyTails)), None)

    @property
    def testable(self) -> bool:
        """Whether there are more channels than parameters; if not, residuals are round-off."""
        return len(self.y) > int(self.free.sum()) + len(self.log_sigma)

    @cached_property
    def _bounds(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Of the change of the parameters, (n,) each."""
        x, at = self.x[: len(self.inputs)], self.free
        low, high = (((end - x) / self.width)[at] for end in (self.lower, self.upper))
        return low, high

    # ----------------------------------------------------------------------------------- data

    def batches(self, y: torch.Tensor) -> Iterator[torch.Tensor]:
        """Rows of y (M, D), data or masks, as many at a time as memory allows."""
        yield from y.split(max(1, int(NUMBERS / y.shape[1] ** 2)))

    def replicates(self, found: "LinearFit", count: int, seed: int) -> torch.Tensor:
        """Data sets (count, D) drawn from the model at a fit (M = 1)."""
        mean = self.mean + self.slopes @ found.change[0]
        covariance = self.error[0] + torch.diag(self.noise.variance(found.log_sigma[0]))
        generator = torch.Generator().manual_seed(seed)
        deviates = torch.randn(count, len(mean), generator=generator, dtype=mean.dtype)
        return mean + deviates @ torch.linalg.cholesky(covariance).mT

    # ----------------------------------------------------------------------------------- fits

    def precision(self, log_sigma: torch.Tensor, keep: torch.Tensor | None = None) -> torch.Tensor:
        """Inverse (M or 1, D, D) of the covariance of all errors at scales of the noise (M, G);
        zero for channels that are not in the mask `keep` (M, D), as if they had not been seen."""
        if not self.noise.groups:
            log_sigma = log_sigma[:1]
        covariance = self.error + torch.diag_embed(self.noise.variance(log_sigma))
        if keep is not None:
            both = keep[:, :, None] & keep[:, None]
            covariance = torch.where(both, covariance, torch.eye(len(self.y)).to(covariance))
        precision = torch.zeros_like(covariance)
        for at in self._hearts:
            own = torch.linalg.cholesky(covariance[:, at, at])
            precision[:, at, at] = torch.cholesky_inverse(own)
        return precision if keep is None else torch.where(both, precision, 0.0)

    @cached_property
    def _hearts(self) -> list[slice]:
        return hearts_of(self.observed)

    def fit(self, y: torch.Tensor, keep: torch.Tensor | None = None) -> "LinearFit":
        """Fit parameters and scales of the noise to every row of y (M, D); to those in `keep`.

        Parameters are the most probable ones within their ranges. Scales maximise the likelihood of
        what the parameters leave (Patterson and Thompson 1971, doi 10.1093/biomet/58.3.545), times
        their prior, by Newton's method: those that maximise it together with the parameters are too
        small.
        """
        log_sigma = self.log_sigma.repeat(len(y), 1)
        change = y.new_zeros(len(y), self.slopes.shape[1])
        rows = torch.arange(len(y) if self.noise.groups else 0)
        for _ in range(SCALE_STEPS):
            if not len(rows):
                break
            seen = None if keep is None else keep[rows]
            found = self._fit_parameters(y[rows], log_sigma[rows], change[rows], seen)
            step = self._scale_step(found)
            change[rows] = found.change
            log_sigma[rows] = (log_sigma[rows] + step).clamp(*LOG_SIGMA_BOUNDS)
            rows = rows[step.abs().amax(1) > SETTLED]
        return self._fit_parameters(y, log_sigma, change, keep)

    def _fit_parameters(self, y, log_sigma, start, keep) -> "LinearFit":
        precision = self.precision(log_sigma, keep)
        error = y - self.mean
        reduced = self.slopes.mT @ precision
        curvature = reduced @ self.slopes + WEAK * torch.eye(self.slopes.shape[1]).to(error)
        change, inner = self._within_ranges(_applied(reduced, error), curvature, start)
        both = inner[:, :, None] & inner[:, None]
        own = torch.where(both, curvature, torch.diag_embed((~inner).to(error)))
        inverse = torch.where(both, torch.linalg.inv(own), 0.0)
        error = error - change @ self.slopes.mT
        pulled = _applied(precision, error)
        return LinearFit(log_sigma, change, error, pulled, precision, reduced, inverse)

    def _within_ranges(self, slope, curvature, start) -> tuple[torch.Tensor, torch.Tensor]:
        """Changes d (M, n) of the parameters that maximise slope d - d' curvature d / 2, and a mask
        of those that are not held at an end."""
        if not start.shape[1]:
            return start, torch.ones_like(start, dtype=torch.bool)
        low, high = self._bounds
        of_row = curvature.expand(len(start), -1, -1)

        def value(rows, d):
            return ((slope[rows] - 0.5 * _applied(of_row[rows], d)) * d).sum(-1)

        def derivatives(rows, d):
            return slope[rows] - _applied(of_row[rows], d), of_row[rows]

        d, _, _ = maximise(value, derivatives, start, low, high, ITERATIONS, LEAST_GAIN)
        gradient = slope - _applied(curvature, d)
        return d, ~((d <= low) & (gradient < 0) | (d >= high) & (gradient > 0))

    def posterior(self, found: "LinearFit") -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (M, n) and covariance (M, n, n) of the change of the parameters, in their ranges."""
        if not self.slopes.shape[1]:
            return found.change, found.inverse
        low, high = (end.expand_as(found.change) for end in self._bounds)
        # About the fit, where the gradient is next to nothing but at an end.
        gradient = found.pulled @ self.slopes
        precision = (found.reduced @ self.slopes).expand(len(found.change), -1, -1)
        precision = precision + WEAK * torch.eye(self.slopes.shape[1]).to(precision)
        ends = (low - found.change, high - found.change)
        _, mean, covariance = integrate(gradient, precision, *ends)
        return found.change + mean, covariance

    def _scale_step(self, found: "LinearFit") -> torch.Tensor:
        """(M, G) of the logarithms of the noise scales."""
        left = found.precision - found.reduced.mT @ found.inverse @ found.reduced
        of_prior = torch.exp(2 * found.log_sigma) / self.noise.prior_scale**2
        change = 2 * self.variances(found)
        excess = found.pulled.square() - left.diagonal(dim1=-2, dim2=-1)
        by_data = 0.5 * _applied(change, excess)
        # The density is that of the logarithm, as in the potential: sigma times that of sigma.
        gradient = by_data - of_prior + 1
        expected = 0.5 * change @ left.square() @ change.mT + torch.diag_embed(2 * of_prior + 2)
        pulled = change * found.pulled[:, None]
        observed = pulled @ left @ pulled.mT - 0.5 * change @ left.square() @ change.mT
        observed = observed + 2 * torch.diag_embed(of_prior - by_data)
        # The observed information, but not less of any direction than a share of the expected one.
        half = torch.linalg.inv(torch.linalg.cholesky(expected))
        size, axes = torch.linalg.eigh(half @ observed @ half.mT)
        root = axes.mT @ half / size.clamp(min=LEAST_INFORMATION).sqrt()[..., None]
        step = _applied(root.mT @ root, gradient)
        return step.clamp(-LONGEST_STEP, LONGEST_STEP)

    def variances(self, found: "LinearFit") -> torch.Tensor:
        """Of each group's inferred noise, (M, G, D)."""
        return torch.exp(2 * found.log_sigma)[..., None] * self.noise.units.square()


@dataclass(frozen=True)
class LinearFit:
    """M data sets with errors e = y - fit of covariance S = P^-1.

    log_sigma (M, G). change (M, n): of the parameters. error: e (M, D). pulled: P e (M, D).
    precision: P (M or 1, D, D). reduced: J'P (M or 1, n, D). inverse (M, n, n): of J'PJ for the
    parameters that are not held at an end of their range, zero for others.
    """

    log_sigma: torch.Tensor
    change: torch.Tensor
    error: torch.Tensor
    pulled: torch.Tensor
    precision: torch.Tensor
    reduced: torch.Tensor
    inverse: torch.Tensor

    @property
    def deviance(self) -> torch.Tensor:
        """e'P e (M,): chi-squared if the model is right."""
        return (self.error * self.pulled).sum(-1)

    def whole(self, patterns: torch.Tensor) -> torch.Tensor:
        """Information c'Pc (M or 1, k) about the amplitude of patterns (D, k), parameters known."""
        return (patterns * (self.precision @ patterns)).sum(-2)

    def information(self, patterns: torch.Tensor) -> torch.Tensor:
        """The same (M, k) of what the parameters leave: one over the variance of the amplitude."""
        taken = self.reduced @ patterns
        return self.whole(patterns) - (taken * (self.inverse @ taken)).sum(-2)

    def gram(self, patterns: torch.Tensor) -> torch.Tensor:
        """The same (M, k, k) of all patterns together."""
        taken = self.reduced @ patterns
        return patterns.mT @ self.precision @ patterns - taken.mT @ self.inverse @ taken

    def left(self, patterns: torch.Tensor) -> torch.Tensor:
        """P (M, D, k) times what the parameters leave of patterns."""
        solved = self.inverse @ (self.reduced @ patterns)
        return self.precision @ patterns - self.reduced.mT @ solved

    def block(self, at: torch.Tensor) -> torch.Tensor:
        """Precision (M, k, k), with the parameters unknown, of k channels."""
        taken = self.reduced[:, :, at]
        return self.precision[:, at[:, None], at] - taken.mT @ self.inverse @ taken

    def diagonal(self) -> torch.Tensor:
        """Of the same precision, (M, D)."""
        taken = (self.reduced * (self.inverse @ self.reduced)).sum(-2)
        return self.precision.diagonal(dim1=-2, dim2=-1) - taken


def _applied(matrix: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
    """Matrices (M or 1, k, l) times rows (M, l)."""
    return rows @ matrix[0].mT if len(matrix) == 1 else (matrix @ rows[..., None])[..., 0]


def _weighted(error: torch.Tensor, noise: Noise, root: torch.Tensor) -> tuple[torch.Tensor, Noise]:
    """Errors and noise with the sd of each channel times `root` (D,)."""
    groups = {name: unit * root for name, unit in noise.groups.items()}
    return error * root[:, None] * root, replace(noise, sd=noise.sd * root, groups=groups)
