"""Exact Gaussian process for all outputs at once, one kernel shared by all.

Intrinsic coregionalisation (`shared_kernel`): the covariance of the training set is a Kronecker
product, one Cholesky factor of the N x N matrix K serves all outputs.
"""

import logging
import time
from dataclasses import asdict
from functools import cached_property
from typing import NamedTuple

import torch

from regional_lv.emulators.base import (
    Emulator,
    Prediction,
    SeparablePrediction,
    TrainingSet,
)
from regional_lv.emulators.kernels import weighted_slopes
from regional_lv.emulators.recalibration import Calibration
from regional_lv.emulators.shared_kernel import (
    SharedKernelGP,
    cholesky,
    condition,
    fit_hyperparameters,
    projected_precision,
    regular,
    subset,
)
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

HYPERPARAMETER_ROWS = 1500
"""Rows that the hyperparameters are fitted to, at most: their likelihood costs O(N^3) per
evaluation and a dozen numbers are well determined long before."""

RESTARTS = 2

SPARSE_ROWS, SPARSE_PENALTY = 1000, 1e-10
"""Simulations of the sparse emulator, and what keeps its weights small. On the paper's 5,541 its
mean costs a twentieth of the exact one, and differs from it by half the noise of MRI: chi2 of 0.6
over all outputs at half of the points of the box."""

ROWS_AT_ONCE = 256
"""Rows of the covariance matrix that are made together: what their derivatives need is made, too,
and for all rows it takes gigabytes."""


FEW_ROWS_SHRINKAGE = 0.1
"""Least shrinkage with no more simulations than outputs: the errors then lie in a subspace, and say
nothing of the directions outside it."""


class Factorised(NamedTuple):
    """Observations of a process with an unknown constant mean: Cholesky factor (n, n) of their
    correlations, what each sees of the mean (n, 1), that whitened, and its squared length."""

    cholesky: torch.Tensor
    constant: torch.Tensor
    ones: torch.Tensor
    total: torch.Tensor

    @classmethod
    def of(
        cls, matrix: torch.Tensor, constant: torch.Tensor, nugget: float, who: str
    ) -> tuple["Factorised", float]:
        """Of correlations (n, n), which change, and the nugget that their factor took."""
        factor, nugget = cholesky(matrix, nugget, who)
        ones = torch.linalg.solve_triangular(factor, constant, upper=False)
        return cls(factor, constant, ones, ones.square().sum()), nugget


class ExactGP(Emulator):
    """Exact multi-output GP with a constant mean (its uncertainty included).

    Settings: kernel; nugget, the smallest value added to the diagonal of the correlation matrix (a
    larger one is learnt where the data ask for it); iterations, L-BFGS iterations per start;
    calibration: `variance_factor` multiplies the variance of errors along the Jacobian by what
    makes 95 % intervals of theta right for the leave-one-out errors of the training set,
    `variance_trend` that of all errors by a power of the mean stiffness first, `student` (the
    default) makes their distribution a multivariate t as well, `intervals` takes their covariance
    from these errors, with that trend and a factor by which 95 % intervals of outputs hold them,
    `none` leaves it as the likelihood has it. The kernel is the same everywhere, but outputs answer
    the more to theta the softer a heart is, and so do the errors; and errors of one simulation are
    large or small together, so that those that no theta explains tell how large those are that move
    the estimate.
    """

    name = "exact_gp"

    # ------------------------------------------------------------------------------- fitting

    def _fit(self, training: TrainingSet, seed: int) -> None:
        started = time.monotonic()
        self._clear_cached()
        learnt = self._learn_hyperparameters(training, seed)
        self.model.requires_grad_(False)
        targets = self._targets(training)
        known = self._known
        self.mean, self.weights = condition(known.cholesky, targets, known.constant)
        self._calibrate(training.y, targets)
        seconds = time.monotonic() - started
        self.info = {
            "rows": len(training.x),
            **learnt,
            "length_scales": self.model.length_scales.tolist(),
            "nugget": self.nugget,
            "seconds": seconds,
            **self.info,
        }
        log.info("%s: fitted to %d simulations in %.1f s", self.name, len(training.x), seconds)

    def _learn_hyperparameters(self, training: TrainingSet, seed: int) -> dict:
        """Set `model` and the nugget; return what the report says of them."""
        rows = subset(len(training.x), HYPERPARAMETER_ROWS, seed)
        s = self.settings
        self.model = fit_hyperparameters(
            training.x[rows],
            training.y[rows],
            s["kernel"],
            s["nugget"],
            s["iterations"],
            RESTARTS,
            seed,
            self.parameters.blocks,
        )
        self.nugget = self.model.nugget
        likelihood = -self.model.loss().item()
        return {"hyperparameter_rows": len(rows), "log_marginal_likelihood": likelihood}

    def _targets(self, training: TrainingSet) -> torch.Tensor:
        """The observations (n, D), in the order of the covariance matrix."""
        return training.y

    def _training_covariance(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Correlations (n, n) of the observations, and what each sees of the mean (n, 1)."""
        matrix = self._correlations_by_parts(self.inputs)
        return matrix, torch.ones(len(matrix), 1, dtype=matrix.dtype)

    @cached_property
    def _known(self) -> Factorised:
        """All observations. Made when first asked for: the mean of a loaded emulator needs none of
        it, and it takes seconds."""
        known, self.nugget = Factorised.of(*self._training_covariance(), self.nugget, self.name)
        return known

    def _clear_cached(self, *names: str) -> None:
        """What is made when first asked for, all of it or these properties, is made anew."""
        for name in names or _CACHED:
            self.__dict__.pop(name, None)

    def _correlations(self, x: torch.Tensor) -> torch.Tensor:
        """Correlations (M, n) of the values at standardised inputs (M, P) with the observations."""
        return self.model.of_values(x, self.inputs).to_dense()

    def _correlations_by_parts(self, x: torch.Tensor) -> torch.Tensor:
        return torch.cat([self._correlations(part) for part in x.split(ROWS_AT_ONCE)])

    def _leave_one_out(self, precision, targets) -> tuple[torch.Tensor, torch.Tensor]:
        """Errors (N, D) and variances (N,) of predicting each simulation from all others."""
        return leave_one_out(precision, targets)

    def _calibrate(self, y, targets) -> None:
        """B, and the factor on the variance from leave-one-out errors of the training set alone."""
        # From whitened targets, so that B is positive whatever the rounding of a stiff K.
        known = self._known
        white = torch.linalg.solve_triangular(known.cholesky, targets, upper=False)
        white = white - known.ones * ((known.ones.T @ white) / known.total)
        b = white.T @ white / (len(targets) - 1)
        precision = projected_precision(known.cholesky, known.constant)
        residuals, variances = self._leave_one_out(precision, targets)
        del precision
        kind, shrinkage = self.settings["calibration"], 0.0
        if kind == "intervals":
            left_out = residuals / variances.sqrt()[:, None]
            b = left_out.T @ left_out / len(left_out)
        if len(y) < 4 * y.shape[1]:
            shrinkage = shrinkage_of(residuals / variances.sqrt()[:, None])
        b = (1 - shrinkage) * b + shrinkage * torch.diag(b.diagonal())
        self.output_b = regular(b)
        self._set_output_covariance()
        factor = torch.linalg.cholesky(self.output_b)
        # Of unit variance in every direction if that is right.
        errors = torch.linalg.solve_triangular(factor, residuals.T, upper=False).T
        errors = errors / variances.sqrt()[:, None]
        theta = self._unstandardise(self.inputs)
        by_theta = torch.cat([self.linearise(part)[1] for part in theta.split(ROWS_AT_ONCE)])
        slopes = by_theta / self.output_sd[:, None]
        slopes = torch.linalg.solve_triangular(factor, slopes, upper=False)
        # Of a study that fixes all stiffness, the inputs that it has count in its place.
        about = list(self.coordinates.softness) or range(theta.shape[1])
        slopes, stiffness = slopes[..., about], self._stiffness(theta)
        self.calibration = Calibration.fit(kind, errors, slopes, stiffness)
        self.info = {
            "calibration": kind,
            **self.calibration.report(errors, slopes, stiffness),
            "output_shrinkage": shrinkage,
            "loo_rmse_standardised": float(residuals.square().mean().sqrt()),
            "loo_rmse": (residuals.square().mean(0).sqrt() * self.output_sd).tolist(),
        }

    def _stiffness(self, theta: torch.Tensor) -> torch.Tensor:
        """Mean (...) over the factors of log theta (..., P); 0 where there are none."""
        factors = theta[..., list(self.coordinates.softness)]
        if not factors.shape[-1]:
            return theta.new_zeros(theta.shape[:-1])
        return factors.log().mean(-1)

    def _set_output_covariance(self) -> None:
        self.output_covariance = self.output_sd[:, None] * self.output_b * self.output_sd

    # ---------------------------------------------------------------------------- predicting

    def _predict(self, theta: torch.Tensor) -> Prediction:
        k = self._correlations(self.standardise(theta.reshape(-1, theta.shape[-1])))
        variance = stated_variance(k, self._known, self.nugget)
        variance = variance.reshape(theta.shape[:-1])
        mean = self._mean(k @ self.weights).reshape(*theta.shape[:-1], -1)
        return self._separable(mean, self.calibration.scale(self._stiffness(theta)) * variance)

    @cached_property
    def sparse(self) -> Emulator:
        """As in the base class: the correlations with `SPARSE_ROWS` simulations, weighted so that
        the mean is nearly the same at all of them; the variance is that of knowing these alone."""
        if len(self.inputs) < 2 * SPARSE_ROWS:
            return self
        rows = subset(len(self.inputs), SPARSE_ROWS, derive(0, "rough"))  # the word only seeds
        sparse = object.__new__(ExactGP)  # also of emulators that learn from more than values
        sparse.__dict__.update(self.__dict__)
        sparse.inputs = self.inputs[rows]
        sparse._clear_cached()
        theta = self._unstandardise(self.inputs)
        mean = torch.cat([self.predict_mean(part) for part in theta.split(ROWS_AT_ONCE)])
        target = (mean - self.output_mean) / self.output_sd - self.mean
        # A penalty keeps the weights small: further equations, whose right side is zero.
        penalty = SPARSE_PENALTY**0.5 * torch.eye(len(rows), dtype=mean.dtype)
        left = torch.cat([sparse._correlations_by_parts(self.inputs), penalty])
        right = torch.cat([target, torch.zeros_like(target[: len(rows)])])
        sparse.weights = torch.linalg.lstsq(left, right).solution
        return sparse

    def _separable(self, mean, variance) -> SeparablePrediction:
        return SeparablePrediction(mean, variance, self.output_covariance, self.calibration.freedom)

    @property
    def jacobian_factor(self) -> float:
        """As in the base class."""
        return self.calibration.factor

    def predict_mean(self, theta: torch.Tensor) -> torch.Tensor:
        """As in the base class: a product with the weights, no triangular solve."""
        x = self.standardise(theta.reshape(-1, theta.shape[-1]))
        return self._mean(self._weighted(x)).reshape(*theta.shape[:-1], -1)

    def with_variance(self, theta: torch.Tensor, variance: torch.Tensor) -> Prediction:
        """As in the base class, without the triangular solves that the own variance takes."""
        return self._separable(self.predict_mean(theta), variance)

    def jacobian(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """As in the base class; the mean's by `linearise`."""
        with torch.enable_grad():
            here = theta.detach().requires_grad_(True)
            (slope,) = torch.autograd.grad(self.predict(here).variance.sum(), here)
        return self.linearise(theta)[1], slope

    @torch.no_grad()
    def linearise(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """As in the base class; O(N) per point, where the variance is O(N^2)."""
        flat = theta.reshape(-1, theta.shape[-1])
        weighted, slopes = self._weighted_slopes(self.standardise(flat))
        slopes = self.output_sd[:, None] * slopes * self.standardise_slope(flat)[:, None, :]
        mean = self._mean(weighted)
        shape = theta.shape[:-1]
        return mean.reshape(*shape, *mean.shape[1:]), slopes.reshape(*shape, *slopes.shape[1:])

    def _mean(self, weighted) -> torch.Tensor:
        """Predicted mean (M, D) from the correlations times the weights (M, D)."""
        return self.output_mean + self.output_sd * (self.mean + weighted)

    def _weighted(self, x: torch.Tensor) -> torch.Tensor:
        """Correlations at `x` (M, P) times the weights, (M, D)."""
        return self._correlations(x) @ self.weights

    def _weighted_slopes(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """`_weighted`, and its derivative (M, D, P) with respect to `x`."""
        return weighted_slopes(self.model.of_values, x, self.inputs, self.weights)

    # --------------------------------------------------------------------------- keeping

    def _select(self, index: torch.Tensor) -> None:
        self.mean, self.weights = self.mean[index], self.weights[:, index].contiguous()
        self.output_b = self.output_b[index][:, index]
        self._clear_cached("sparse")
        self._set_output_covariance()

    def _state(self) -> dict:
        # The Cholesky factor is made again: a quarter of a gigabyte at N = 5,661.
        return {key: getattr(self, key) for key in _STATE} | {
            "model": self.model.state_dict(),
            "calibration": asdict(self.calibration),
        }

    def _restore(self, state: dict) -> None:
        for key in _STATE:
            setattr(self, key, state[key])
        self.calibration = Calibration(**state["calibration"])
        self.model = self._make_model()
        self.model.load_state_dict(state["model"])
        self.model.requires_grad_(False)
        self._set_output_covariance()

    def _make_model(self) -> SharedKernelGP:
        s = self.settings
        return SharedKernelGP(
            s["kernel"], len(self.parameters), s["nugget"], self.parameters.blocks
        )


_STATE = ("nugget", "mean", "weights", "output_b")

_CACHED = ("sparse", "_known", "_for_variance", "_by_simulation")
"""Properties that are made when first asked for, those of subclasses among them."""


# ------------------------------------------------------------------------- linear algebra, LOO


def stated_variance(k: torch.Tensor, known: Factorised, nugget: float) -> torch.Tensor:
    """Variances (M,) of predictions with an unknown constant mean, of unit prior variance.

    k: (M, n) correlations with the observations that are `known`.
    """
    half = torch.linalg.solve_triangular(known.cholesky, k.T, upper=False)
    rest = 1 - (known.ones.T @ half)[0]
    variance = 1 + nugget - half.square().sum(0) + rest.square() / known.total
    return variance.clamp(min=nugget)


def leave_one_out(precision: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Errors (..., N, D) and variances (..., N) of predicting each row from all others, in closed
    form, of the projected precision Q (..., N, N).

    With the constant mean estimated anew each time: e_i = [Q y]_i / Q_ii, v_i = 1 / Q_ii
    (Dubrule 1983, doi 10.1007/BF01033233).
    """
    diagonal = precision.diagonal(dim1=-2, dim2=-1)
    return (precision @ y) / diagonal[..., None], 1 / diagonal


def shrinkage_of(z: torch.Tensor) -> float:
    """Share of the diagonal in the covariance of `z` (N, D), mean zero, by oracle approximating
    shrinkage (Chen et al. 2010, doi 10.1109/TSP.2010.2053029).

    With few simulations the sample covariance of many outputs is singular or too narrow.
    """
    from sklearn.covariance import oas  # slow to load, and most jobs load this module

    unit = z / z.square().mean(0).sqrt()
    least = FEW_ROWS_SHRINKAGE if len(z) <= z.shape[1] else 0.0
    return max(least, float(oas(unit.numpy(), assume_centered=True)[1]))
