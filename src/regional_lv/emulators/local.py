"""Local Gaussian processes: trained anew for every observation, on the simulations near it.

Near means in output space (Davies et al. 2019, doi 10.1111/rssc.12374; Noe et al. 2019,
doi 10.1098/rsif.2019.0114): the parameters of the observation are what is sought.
"""

import copy
import logging
import math

import torch

from regional_lv.emulators import networks
from regional_lv.emulators.kernels import correlation, mean_slopes
from regional_lv.emulators.optimise import lbfgs
from regional_lv.emulators.reduced import ReducedEmulator, held_out, row_jacobian
from regional_lv.emulators.shared_kernel import (
    cholesky,
    condition,
    fit_hyperparameters,
    projected_precision,
    regular,
    subset,
)
from regional_lv.errors import InputError

log = logging.getLogger(__name__)

START_ROWS, START_ITERATIONS = 500, 60
"""The fit to simulations from everywhere from which every local fit starts."""

CALIBRATION_CASES = 20
"""Simulations held out to calibrate on, at most (and at most a tenth of all)."""

BOUNDS = [(-3.0, 6.0), (-3.0, 5.0), (math.log(1e-10), 0.0)]
"""Of the logarithms of length scales, alpha and nugget."""

LEAST_NUGGET = 1e-8


class LocalGP(ReducedEmulator):
    """Exact GP on the `neighbours` nearest simulations, with a constant mean.

    joint: one kernel for all scores and a coregionalisation matrix (ICM), or else one GP for each
    score by itself. deep: the kernel sees features h(x) = x + network(x), network and kernel
    trained together by the marginal likelihood (deep kernel learning, Wilson et al. 2016,
    arXiv:1511.02222).

    `fit` keeps the training set, trains one such GP for all scores on simulations from everywhere,
    from which every local fit starts, and calibrates: it holds a few simulations out, trains
    locally for each, and multiplies all variances by what their errors ask for.
    """

    joint: bool
    deep: bool
    _KEYS = ("scores", "kernel", "start", "variance_factor", "local")

    # ------------------------------------------------------------------------------- fitting

    def _fit_scores(self, x, z, seed):
        count = self.settings["neighbours"]
        inside, outside = held_out(len(x), min(0.1, CALIBRATION_CASES / len(x)), seed)
        if len(inside) < count:
            raise InputError(
                f"{self.name}: {len(x)} simulations are too few for {count} neighbours and "
                f"{len(outside)} to calibrate on; simulate more, or lower {self.name}.neighbours"
            )
        self.kernel = self._choose_kernel(x, z, LEAST_NUGGET, seed)
        self.start = self._start(x[inside], z[inside], seed)
        self.variance_factor, self.scores = 1.0, z
        ratios = []
        for i in outside:
            near = inside[self._nearest(self.scores[i] @ self.to_outputs.T, inside)]
            trial = copy.copy(self)
            trial.local = trial._train(x[near], z[near])
            error, spread = z[i] - trial._mean(x[i, None])[0], trial._covariance(x[i, None])[0]
            if spread.ndim == 1:
                spread = torch.diag(spread)
            ratios.append(error @ torch.linalg.solve(spread, error) / len(error))
        self.variance_factor = max(1.0, float(torch.stack(ratios).mean()))
        self.local = None
        self.info |= {"variance_factor": self.variance_factor, "calibration_cases": len(outside)}

    def _start(self, x, z, seed) -> list[torch.Tensor]:
        """Parameters of a GP for all scores on some of all simulations, one copy for each GP."""
        rows = subset(len(x), START_ROWS, seed)
        x, z = x[rows], z[rows]
        h = fit_hyperparameters(x, z, self.kernel, LEAST_NUGGET, START_ITERATIONS, 1, seed)
        scales = h.length_scales.log().clamp(*BOUNDS[0])[None]
        start = [scales, *(torch.tensor([math.log(v)], dtype=x.dtype) for v in (h.alpha, h.nugget))]
        if self.deep:
            layers = networks.initial([x.shape[1], *self.settings["hidden"], x.shape[1]], seed)
            start += [tensor.double()[None] for layer in layers for tensor in layer]
            # Zero last weights: training starts from the GP without a network.
            start[-2].zero_()
            start = self._minimise(start, x, z[None], START_ITERATIONS)
        groups = 1 if self.joint else z.shape[1]
        return [tensor.repeat(groups, *[1] * (tensor.ndim - 1)) for tensor in start]

    def localise(self, y: torch.Tensor) -> "LocalGP":
        """Train on the simulations nearest to `y` (D,): Euclidean, in training sd of each output.

        Raises InputError for an observation of another length than the emulator's outputs.
        """
        if y.shape != self.output_mean.shape:
            raise InputError(
                f"{self.name}: the observation has the shape {tuple(y.shape)}; expected "
                f"{tuple(self.output_mean.shape)}, one number per output"
            )
        target = (y - self.output_mean) / self.output_sd
        rows = self._nearest(target, torch.arange(len(self.scores)))
        fitted = copy.copy(self)
        fitted.local = self._train(self.inputs[rows], self.scores[rows])
        return fitted

    def _nearest(self, target, rows) -> torch.Tensor:
        """Places in `rows` of the simulations nearest to the standardised outputs `target`."""
        distance = (self.scores[rows] @ self.to_outputs.T - target).square().sum(1)
        return distance.topk(self.settings["neighbours"], largest=False).indices.sort().values

    def _minimise(self, start, x, targets, iterations) -> list[torch.Tensor]:
        found, _ = lbfgs(
            lambda p: self._negative_log_likelihood(p, x, targets),
            start,
            [*BOUNDS, *[None] * (len(start) - len(BOUNDS))],
            iterations,
        )
        return found

    def _train(self, x, z) -> dict:
        targets = z[None] if self.joint else z.T[..., None]
        parameters = self._minimise(self.start, x, targets, self.settings["iterations"])
        matrix, nugget = self._covariances(parameters, x)
        factor, least = cholesky(matrix, LEAST_NUGGET, self.name)
        constant = torch.ones(len(x), 1, dtype=x.dtype)
        mean, weights = condition(factor, targets, constant)
        precision, total = projected_precision(factor, constant)
        eye = torch.eye(len(x), dtype=x.dtype).expand_as(factor)
        return {
            "features": self._features(parameters, x),
            "parameters": parameters,
            "noise": nugget + least,
            "mean": mean,
            "weights": weights,
            "b": self.variance_factor * self._scale(targets, precision @ targets),
            "whiten": torch.linalg.solve_triangular(factor, eye, upper=False),
            "total": total,
        }

    def _negative_log_likelihood(self, parameters, x, targets) -> torch.Tensor:
        """Restricted, with the signal variances (or B) at their maximum; sum over the GPs, per row;
        `targets` (1, n, K) for one GP of all scores, or (K, n, 1) for a GP of each.

        (n - 1)/2 log|B| + o/2 (log|K| + log(1' K^-1 1)) for the o scores of each GP.
        """
        matrix, _ = self._covariances(parameters, x)
        eye = torch.eye(len(x), dtype=x.dtype)
        factor = torch.linalg.cholesky(matrix + LEAST_NUGGET * eye)
        ones = torch.ones_like(factor[..., :1])
        white, one = (
            torch.linalg.solve_triangular(factor, t, upper=False) for t in (targets, ones)
        )
        total = one.square().sum(1, keepdim=True)
        white = white - one * ((one.mT @ white) / total)
        logs = 2 * factor.diagonal(dim1=-2, dim2=-1).log().sum(-1) + total[:, 0, 0].log()
        b = self._scale(white, white)
        value = (len(x) - 1) * torch.linalg.slogdet(b)[1] + b.shape[-1] * logs
        return 0.5 * value.sum() / len(x)

    def _scale(self, left, right) -> torch.Tensor:
        """B (1, K, K), or the signal variances (K, 1, 1), from whitened targets."""
        b = left.mT @ right / (left.shape[1] - 1)
        if left.shape[1] <= b.shape[-1]:
            # No more simulations than scores leave B singular.
            b = torch.diag_embed(b.diagonal(dim1=-2, dim2=-1))
        return regular(b)

    def _covariances(self, parameters, x) -> tuple[torch.Tensor, torch.Tensor]:
        """Correlations (G, n, n) with the learnt nuggets (G,) on the diagonal, and these."""
        features = self._features(parameters, x)
        scales, alpha, nugget = (p.exp() for p in parameters[:3])
        matrix = correlation(self.kernel, features, features, scales, alpha)
        return matrix + nugget[:, None, None] * torch.eye(len(x), dtype=x.dtype), nugget

    def _features(self, parameters, x):
        """h(x), (G, M, P), or the inputs themselves."""
        layered = parameters[len(BOUNDS) :]
        if not layered:
            return x
        return x + networks.forward(list(zip(layered[::2], layered[1::2], strict=True)), x)

    # ---------------------------------------------------------------------------- predicting

    def _localised(self) -> dict:
        """The local fit. Raises InputError before `localise`."""
        if self.local is None:
            raise InputError(
                f"{self.name}: a local emulator predicts for one observation; call localise(y) "
                "with its outputs and use what that returns"
            )
        return self.local

    def _correlations(self, x) -> torch.Tensor:
        """(G, M, n) with the neighbours."""
        local = self._localised()
        scales, alpha = (p.exp() for p in local["parameters"][:2])
        features = self._features(local["parameters"], x)
        return correlation(self.kernel, features, local["features"], scales, alpha)

    def _mean(self, x):
        k = self._correlations(x)
        mean = self.local["mean"][:, None, :] + k @ self.local["weights"]
        return mean[0] if self.joint else mean[..., 0].T

    def _mean_jacobian(self, x):
        local = self._localised()
        parameters = local["parameters"]
        scales, alpha = (p.exp() for p in parameters[:2])
        weights = local["weights"].mT.reshape(-1, local["weights"].shape[1])
        features = self._features(parameters, x)
        by_features = mean_slopes(self.kernel, features, local["features"], scales, alpha, weights)
        if not self.deep:
            return by_features.permute(1, 0, 2)
        inner = row_jacobian(lambda at: self._features(parameters, at), x)
        return (by_features[..., None, :] @ inner)[..., 0, :].permute(1, 0, 2)

    def _covariance(self, x):
        local = self.local
        half = self._correlations(x) @ local["whiten"].mT
        rest = 1 - half @ local["whiten"].sum(-1)[..., None]
        variance = 1 + local["noise"][:, None] - half.square().sum(-1)
        variance = variance + rest[..., 0].square() / local["total"][:, None]
        variance = variance.clamp(min=LEAST_NUGGET)
        if self.joint:
            return variance[0, :, None, None] * local["b"]
        return (variance * local["b"][:, 0]).T
