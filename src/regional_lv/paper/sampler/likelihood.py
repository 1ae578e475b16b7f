"""How probable the observed outputs are at theta: emulator error and measurement noise together."""

import math
from dataclasses import replace

import torch
from scipy import stats

from regional_lv.emulators.base import Emulator, Prediction, SeparablePrediction
from regional_lv.emulators.gaussian import LOG_2PI
from regional_lv.inference.noise import Noise


class Likelihood:
    """Log density of `y` (..., D) under N(emulator mean, emulator covariance + noise).

    y: one observation, or several with leading dimensions that broadcast against those of theta.
    Uses the paper's multi-output form; the predictive covariance varies with theta, so its
    determinant is part of the density.

    Without noise the density is that of the t distribution if the prediction has one. With noise it
    is Gaussian: the sum of a t and a Gaussian deviate has no density in closed form, and emulators
    are made to err less than one measures.

    Where the emulator's covariance is a scalar times a fixed matrix B, and the noise R is known, or
    known but for one scale, both are made diagonal once: with B = L L' and
    L^-1 R L^-T = U diag(rho) U', the covariance v B + R has the variances v + rho along the columns
    of L^-T U.

    jacobian: d(mean)/d(theta) (D, P) about where the posterior is; B is `inflate`d along it by the
    emulator's `jacobian_factor` then. See `near`.
    """

    def __init__(
        self,
        emulator: Emulator,
        y: torch.Tensor,
        noise: Noise,
        jacobian: torch.Tensor | None = None,
    ):
        self.emulator, self.y, self.noise, self.jacobian = emulator, y, noise, jacobian
        with torch.no_grad():
            prediction = emulator.predict((emulator.lower * emulator.upper).sqrt())
        self.separable = isinstance(prediction, SeparablePrediction)
        self._whiten, self._freedom = None, math.inf
        if self.separable:
            self._output_covariance = prediction.output_covariance
            if jacobian is not None:
                self._output_covariance = inflate(
                    prediction.output_covariance, jacobian, emulator.jacobian_factor
                )
        # The sd of R, to be multiplied by the one unknown scale if there is one.
        unit = noise.sd
        if len(noise.groups) == 1 and not (noise.sd > 0).any():
            (unit,) = noise.groups.values()
        if self.separable and (unit is not noise.sd or not noise.groups):
            factor = torch.linalg.cholesky(self._output_covariance)
            half = torch.linalg.solve_triangular(factor, torch.diag(unit), upper=False)
            rho, basis = torch.linalg.eigh(half @ half.T)
            inverse_rows = torch.linalg.solve_triangular(factor.T, basis, upper=True)
            self._whiten = inverse_rows.contiguous()  # residual @ this is whitened, (D, D)
            self._rho = rho.clamp(min=0.0)
            self._freedom = noise.freedom_beside(prediction)
            self._constant = -factor.diagonal().log().sum() - 0.5 * len(rho) * LOG_2PI

    @property
    def inputs(self) -> int:
        """Number P of parameters."""
        return len(self.emulator.lower)

    @property
    def one_scale(self) -> bool:
        """Whether the noise is unknown but for one scale of all outputs."""
        return bool(self.noise.groups) and self._whiten is not None

    def at(self, y: torch.Tensor) -> "Likelihood":
        """The same likelihood for other observations; nothing is factorised again."""
        other = object.__new__(Likelihood)
        other.__dict__.update(self.__dict__, y=y)
        return other

    @property
    def sparse(self) -> "Likelihood":
        """That of the sparse emulator; itself if there is none."""
        sparse = self.emulator.sparse
        if sparse is self.emulator:
            return self
        other = self.at(self.y)
        other.emulator = sparse
        return other

    def near(self, theta: torch.Tensor) -> "Likelihood":
        """The same observations with the emulator's errors as large as they are along the Jacobian
        at `theta` (P,), about where the posterior is; itself for an emulator that is none the worse
        there."""
        if not self.separable or self.emulator.jacobian_factor == 1.0:
            return self
        jacobian = self.emulator.linearise(theta[None])[1][0]
        return Likelihood(self.emulator, self.y, self.noise, jacobian)

    def tempered(self, level: float) -> "Likelihood":
        """The same observations with further noise of `level` training sd on every output."""
        more = level * self.emulator.output_sd
        noise = replace(self.noise, sd=(self.noise.sd.square() + more.square()).sqrt())
        return Likelihood(self.emulator, self.y, noise, self.jacobian)

    def log_density(
        self, theta: torch.Tensor, log_sigma: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Log p(y | theta, sigma), (...), at `theta` (..., P) and `log_sigma` (..., G)."""
        return self.of_prediction(self.emulator.predict(theta), log_sigma)

    def of_prediction(
        self, prediction: Prediction, log_sigma: torch.Tensor | None = None
    ) -> torch.Tensor:
        """The same (...) for what the emulator predicts at theta."""
        residual = self.y - prediction.mean
        if self._whiten is not None:
            scale = 1.0
            if self.noise.groups:
                assert log_sigma is not None
                scale = torch.exp(2 * log_sigma)
            variances = prediction.variance[..., None] + scale * self._rho
            white = residual @ self._whiten
            length = self.of_length((white * white / variances).sum(-1))
            return self._constant - length - 0.5 * variances.log().sum(-1)
        return _LogNormal.apply(residual, self.covariance(prediction, log_sigma))

    def of_length(self, square: torch.Tensor) -> torch.Tensor:
        """What the squared length (...) of whitened residuals takes from the log density.

        Of the t, (nu + D) / 2 times log(1 + square / nu); square / 2 in the limit of a Gaussian.
        """
        if math.isinf(self._freedom):
            return 0.5 * square
        nu, outputs = self._freedom, self.y.shape[-1]
        constant = math.lgamma(nu / 2) - math.lgamma((nu + outputs) / 2)
        constant += 0.5 * outputs * math.log(nu / 2)
        return constant + 0.5 * (nu + outputs) * torch.log1p(square / nu)

    def of_length_slope(self, square: torch.Tensor) -> torch.Tensor:
        """Twice the slope (...) of `of_length`: what the errors' precision is multiplied by when
        their size is known to be that of the residuals."""
        if math.isinf(self._freedom):
            return torch.ones_like(square)
        return (self._freedom + self.y.shape[-1]) / (self._freedom + square)

    def covariance(
        self, prediction: Prediction, log_sigma: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Of the observations (..., D, D) where the emulator predicts `prediction`."""
        if log_sigma is None:
            log_sigma = torch.zeros(*prediction.mean.shape[:-1], 0, dtype=torch.float64)
        error = prediction.covariance
        if self.separable:
            error = prediction.variance[..., None, None] * self._output_covariance
        return error + torch.diag_embed(self.noise.variance(log_sigma))

    def draw(
        self, theta: torch.Tensor, log_sigma: torch.Tensor, generator: torch.Generator
    ) -> torch.Tensor:
        """One draw of the outputs (S, D), natural units, per row of `theta` (S, P) and `log_sigma`
        (S, G), from this density: the emulator's error and the measurement noise included."""
        with torch.no_grad():
            prediction = self.emulator.predict(theta)
            mean = prediction.mean
            deviates = torch.randn(mean.shape, generator=generator, dtype=torch.float64)
            if self.separable:
                factor = torch.linalg.cholesky(self._output_covariance)
                error = prediction.variance[:, None].sqrt() * (deviates @ factor.T)
                freedom = self.noise.freedom_beside(prediction)
                if math.isfinite(freedom):
                    share = torch.rand((len(theta), 1), generator=generator, dtype=torch.float64)
                    chi2 = torch.as_tensor(stats.chi2.ppf(share.numpy(), freedom))
                    error = error * (freedom / chi2).sqrt()
            else:
                factor = torch.linalg.cholesky(prediction.covariance)
                error = (factor @ deviates[..., None])[..., 0]
            more = torch.randn(mean.shape, generator=generator, dtype=torch.float64)
            return mean + error + more * self.noise.variance(log_sigma).sqrt()

    def information(
        self, theta: torch.Tensor, log_sigma: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Expected information (..., P, P) about (log theta, log sigma); positive semi-definite.

        J' S^-1 J from the mean and, for every number c the covariance S depends on, half
        tr(S^-1 S_a S^-1 S_b). The variation of a covariance that is not separable is left out.
        Expected of a Gaussian; for a t, of errors that are as large as the residuals at `theta`.
        """
        with torch.no_grad():
            prediction = self.emulator.predict(theta)
            by_theta, variance_slope = self.emulator.jacobian(theta)
            jacobian = by_theta * theta[..., None, :]
            if self._whiten is not None and not self.noise.groups:
                weights = 1 / (prediction.variance[..., None] + self._rho)
                white = self._whiten.T @ jacobian
                slope = variance_slope * theta
                # Of one size of the errors known beforehand; a t hardly knows it.
                strength = 0.5 * weights.square().sum(-1) * float(math.isinf(self._freedom))
                square = ((self.y - prediction.mean) @ self._whiten).square() * weights
                sharper = self.of_length_slope(square.sum(-1))
                information = white.mT @ (weights[..., None] * white)
                return sharper[..., None, None] * information + strength[..., None, None] * (
                    slope[..., :, None] * slope[..., None, :]
                )
            return self._dense_information(theta, log_sigma, prediction, jacobian, variance_slope)

    def _dense_information(self, theta, log_sigma, prediction, jacobian, variance_slope):
        factor = torch.linalg.cholesky(self.covariance(prediction, log_sigma))
        white = torch.linalg.solve_triangular(factor, jacobian, upper=False)
        p, g = jacobian.shape[-1], len(self.noise.groups)
        information = torch.zeros(*theta.shape[:-1], p + g, p + g, dtype=theta.dtype)
        information[..., :p, :p] = white.mT @ white
        # What the covariance depends on: the separable variance (if any), then each sigma.
        changes = [
            torch.diag_embed(2 * torch.exp(2 * log_sigma[..., i, None]) * unit.square())
            for i, unit in enumerate(self.noise.groups.values())
        ]
        to_parameters = torch.zeros(*theta.shape[:-1], len(changes), p + g, dtype=theta.dtype)
        to_parameters[..., range(g), range(p, p + g)] = 1.0
        if self.separable:
            changes.insert(0, self._output_covariance.expand(*theta.shape[:-1], -1, -1))
            row = torch.zeros(*theta.shape[:-1], 1, p + g, dtype=theta.dtype)
            row[..., 0, :p] = variance_slope * theta
            to_parameters = torch.cat([row, to_parameters], dim=-2)
        if changes:
            ratios = [torch.cholesky_solve(change, factor) for change in changes]
            fisher = torch.stack(
                [
                    torch.stack([0.5 * (a * b.mT).sum((-2, -1)) for b in ratios], dim=-1)
                    for a in ratios
                ],
                dim=-2,
            )
            information = information + to_parameters.mT @ fisher @ to_parameters
        return information


def inflate(covariance: torch.Tensor, jacobian: torch.Tensor, factor: float) -> torch.Tensor:
    """B + (f - 1) J (J' B^-1 J)^-1 J': a covariance B (D, D) of errors with `factor` f times the
    variance along the columns of the Jacobian J (D, P), and the same variance across them.

    Errors along the Jacobian are what inference mistakes for a change of theta, and an emulator's
    covariance, the same for all theta, can be right for the mean square of all errors and wrong
    there. The generalised least-squares estimate is that of B, with f times its variance.
    """
    half = torch.linalg.cholesky(covariance)
    white = torch.linalg.solve_triangular(half, jacobian, upper=False)
    basis, size, _ = torch.linalg.svd(white, full_matrices=False)
    # A parameter that moves no output has no direction.
    moved = half @ (basis * (size > 1e-8 * size[..., :1])[..., None, :])
    return covariance + (factor - 1) * moved @ moved.mT


class _LogNormal(torch.autograd.Function):
    """Log density of residuals (..., D) under N(0, S), S (..., D, D), with its closed-form
    gradient: -alpha and (alpha alpha' - S^-1) / 2, alpha = S^-1 residual.

    An S without Cholesky factor is impossible, and leaves the others of a batch alone."""

    @staticmethod
    def forward(ctx, residual, covariance):
        factor, failed = torch.linalg.cholesky_ex(covariance)
        lost = failed > 0
        factor = torch.where(lost[..., None, None], torch.eye(factor.shape[-1]).to(factor), factor)
        alpha = torch.cholesky_solve(residual[..., None], factor)
        ctx.save_for_backward(alpha, factor)
        logs = factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
        distance = (residual * alpha[..., 0]).sum(-1)
        density = -0.5 * (distance + residual.shape[-1] * LOG_2PI) - logs
        # LAPACK may also hand out a factor of numbers that are none.
        return torch.where(lost | ~torch.isfinite(density), -math.inf, density)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, by_value):
        alpha, factor = ctx.saved_tensors
        by_covariance = 0.5 * (alpha * alpha.mT - torch.cholesky_inverse(factor))
        return -by_value[..., None] * alpha[..., 0], by_value[..., None, None] * by_covariance
