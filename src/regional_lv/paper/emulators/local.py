"""Local Gaussian processes: trained anew for every observation, on the simulations near it.

Near means in output space (Davies et al. 2019, doi 10.1111/rssc.12374; Noe et al. 2019,
doi 10.1098/rsif.2019.0114): the parameters of the observation are what is sought.
"""

import copy
import itertools
import math

import gpytorch
import torch
from gpytorch.constraints import GreaterThan
from gpytorch.likelihoods import GaussianLikelihood
from linear_operator.utils.cholesky import psd_safe_cholesky

from regional_lv.emulators.base import row_jacobian
from regional_lv.emulators.kernels import Blocks, make_kernel, weighted_slopes
from regional_lv.emulators.optimise import fit
from regional_lv.emulators.reduced import ReducedEmulator, held_out
from regional_lv.emulators.shared_kernel import fit_hyperparameters, profile, subset
from regional_lv.errors import InputError
from regional_lv.paper.emulators import networks

START_ROWS, START_ITERATIONS = 500, 60
"""The fit to simulations from everywhere from which every local fit starts."""

CALIBRATION_CASES = 20
"""Simulations held out to calibrate on, at most (and at most a tenth of all)."""

LEAST_NUGGET = 1e-8

BOUNDS = {
    "raw_lengthscale": (-3.0, 6.0),
    "raw_alpha": (-3.0, 5.0),
    "raw_noise": (math.log(1e-10), 0.0),
}
"""Of the logarithms of length scales, of alpha and of what is added to the least nugget."""


class BatchLinear(torch.nn.Module):
    """`torch.nn.Linear` for each of a batch of GPs: from (*batch, M, in) to (*batch, M, out)."""

    def __init__(self, inputs: int, outputs: int, batch: torch.Size):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(*batch, inputs, outputs))
        self.bias = torch.nn.Parameter(torch.zeros(*batch, 1, outputs))

    def forward(self, x):
        return x @ self.weight + self.bias


class LocalModel(gpytorch.models.ExactGP):
    """Exact GP of K scores with constant means.

    joint: one kernel of unit variance for all scores, whose covariance is B times it (ICM,
    Bonilla et al. 2007); or else a batch of K GPs, each with its own kernel and signal variance.
    hidden: widths of a network whose features h(x) = x + network(x) the kernel sees (deep kernel
    learning, Wilson et al. 2016, arXiv:1511.02222), one for each kernel; None for no network.

    The likelihood's noise is the nugget, in units of the signal variance. Training set: inputs
    (n, P) and scores (K, n). Called as a model of GPyTorch it gives the posterior for a unit signal
    variance and known constants; `mean` and `covariance` give what is predicted at each point.
    """

    def __init__(
        self,
        kernel: str,
        inputs: int,
        scores: int,
        joint: bool,
        hidden: list[int] | None,
        blocks: Blocks = (),
    ):
        batch = torch.Size(() if joint else (scores,))
        noise = GreaterThan(LEAST_NUGGET, transform=torch.exp, inv_transform=torch.log)
        super().__init__(None, None, GaussianLikelihood(noise_constraint=noise, batch_shape=batch))
        self.joint = joint
        self.mean_module = gpytorch.means.ConstantMean(batch_shape=torch.Size([scores]))
        self.covar_module = make_kernel(kernel, inputs, blocks, batch)
        self.network = None
        if hidden is not None:
            layers = []
            for widths in itertools.pairwise([inputs, *hidden, inputs]):
                layers += [BatchLinear(*widths, batch), torch.nn.SiLU()]
            self.network = torch.nn.Sequential(*layers[:-1])
        self.double()

    def forward(self, x):
        h = self.features(x).expand(*self.mean_module.batch_shape, -1, -1)
        return gpytorch.distributions.MultivariateNormal(self.mean_module(h), self.covar_module(h))

    def features(self, x: torch.Tensor) -> torch.Tensor:
        """h(x), (M, P) or (K, M, P), or the inputs themselves."""
        return x if self.network is None else x + self.network(x)

    # ------------------------------------------------------------------------------ training

    def train_on(self, x: torch.Tensor, z: torch.Tensor, start: dict, iterations: int) -> None:
        """Fit to inputs (n, P) and scores (n, K) from the parameters `start`, of a model for all
        scores; without iterations only condition on them."""
        self.set_train_data(x, z.T, strict=False)
        free = [(n, p) for n, p in self.named_parameters() if not n.startswith("mean_module")]
        with torch.no_grad():
            for name, parameter in free:
                parameter.copy_(start[name])
        if iterations:
            fit(free, self.loss, BOUNDS, iterations)

    def _covariance_matrix(self) -> torch.Tensor:
        """Of the training set, for a unit signal variance, (n, n) or (K, n, n)."""
        matrix = self.covar_module(self.features(self.train_inputs[0])).to_dense()
        eye = torch.eye(matrix.shape[-1], dtype=matrix.dtype)
        return matrix + self.likelihood.noise[..., None] * eye

    def _profile(self, factor: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """What is most likely given the Cholesky factor of the covariance matrix C: B (K, K) or
        (K, 1, 1), constants (1, K) or (K, 1, 1), whitened scores less these, and 1' C^-1 1."""
        z = self.train_targets
        columns = z.T if self.joint else z[..., None]
        return profile(factor, columns)

    def loss(self) -> torch.Tensor:
        """Minus the restricted log likelihood, with the signal variances (or B) at their maximum;
        the sum over the GPs, per row.

        (n - 1)/2 log|B| + d/2 (log|C| + log(1' C^-1 1)) for the d scores of each GP.
        """
        factor = torch.linalg.cholesky(self._covariance_matrix())
        b, _, _, total = self._profile(factor)
        n, d = factor.shape[-1], b.shape[-1]
        logs = 2 * factor.diagonal(dim1=-2, dim2=-1).log().sum(-1) + total[..., 0].log()
        return 0.5 * ((n - 1) * torch.linalg.slogdet(b)[1] + d * logs).sum() / n

    # ---------------------------------------------------------------------------- predicting

    # GPyTorch's own posterior is that of all points together, and repeats one kernel for each of K
    # scores: variances at single points take 3 to 70 times as long. It takes constants as known.

    @torch.no_grad()
    def prepare(self) -> None:
        """Make what predictions need of the training set."""
        self.eval().requires_grad_(False)
        self.seen = self.features(self.train_inputs[0])
        factor = psd_safe_cholesky(self._covariance_matrix())
        self.b, constant, white, self.total = self._profile(factor)
        self.mean_module.initialize(constant=constant.reshape(-1))
        self.weights = torch.linalg.solve_triangular(factor.mT, white, upper=True)
        eye = torch.eye(factor.shape[-1], dtype=factor.dtype).expand_as(factor)
        self.whiten = torch.linalg.solve_triangular(factor, eye, upper=False).mT

    def _correlations(self, x) -> torch.Tensor:
        """With the training set, (M, n) or (K, M, n)."""
        return self.covar_module(self.features(x), self.seen).to_dense()

    def mean(self, x: torch.Tensor) -> torch.Tensor:
        """(M, K) at inputs (M, P), or (K, M, P) for each GP of a batch its own."""
        weighted = self._correlations(x) @ self.weights
        return self.mean_module.constant + (weighted if self.joint else weighted[..., 0].T)

    def mean_jacobian(self, x: torch.Tensor) -> torch.Tensor:
        """d(mean)/dx (M, K, P)."""
        if self.joint:
            h = self.features(x)
            _, by_h = weighted_slopes(self.covar_module, h, self.seen, self.weights)
            return by_h if self.network is None else by_h @ row_jacobian(self.features, x)
        with torch.enable_grad():
            # With inputs of its own for each GP of the batch one backward pass serves all.
            at = x.repeat(len(self.train_targets), 1, 1).requires_grad_(True)
            (slopes,) = torch.autograd.grad(self.mean(at).sum(), at)
        return slopes.transpose(0, 1).contiguous()

    def covariance(self, x: torch.Tensor) -> torch.Tensor:
        """Of the scores with noise and with the uncertainty of the constants, (M, K, K); their
        variances (M, K) for a batch of GPs."""
        half = self._correlations(x) @ self.whiten
        rest = 1 - (half @ self.whiten.sum(-2)[..., None])[..., 0]
        variance = 1 + self.likelihood.noise - half.square().sum(-1) + rest.square() / self.total
        variance = variance.clamp(min=LEAST_NUGGET)
        if self.joint:
            return variance[:, None, None] * self.b
        return (variance * self.b[..., 0]).T


class LocalGP(ReducedEmulator):
    """`LocalModel` of the `neighbours` nearest simulations.

    joint: one kernel for all scores and a coregionalisation matrix, or else one GP for each score
    by itself. With a setting `hidden` there is a network in front of the kernel.

    `fit` keeps the training set, trains one such GP for all scores on simulations from everywhere,
    from which every local fit starts, and calibrates: it holds a few simulations out, trains
    locally for each, and multiplies all variances by what their errors ask for.
    """

    joint: bool
    _KEYS = ("scores", "kernel", "start", "variance_factor")

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
        self.variance_factor, self.scores, self.local = 1.0, z, None
        self.start = self._start(x[inside], z[inside], seed)
        ratios = []
        for i in outside:
            trial = self._train(inside[self._nearest(z[i] @ self.to_outputs.T, inside)])
            at = x[i, None]
            error, spread = z[i] - trial._mean(at)[0], trial._covariance(at)[0]
            if spread.ndim == 1:
                spread = torch.diag(spread)
            ratios.append(error @ torch.linalg.solve(spread, error) / len(error))
        self.variance_factor = max(1.0, float(torch.stack(ratios).mean()))
        self.info |= {"variance_factor": self.variance_factor, "calibration_cases": len(outside)}

    def _model(self, joint: bool) -> LocalModel:
        sizes = self.inputs.shape[1], self.scores.shape[1]
        hidden, blocks = self.settings.get("hidden"), self.parameters.blocks
        return LocalModel(self.kernel, *sizes, joint, hidden, blocks)

    def _start(self, x, z, seed) -> dict[str, torch.Tensor]:
        """Parameters of a GP for all scores on some of all simulations."""
        rows = subset(len(x), START_ROWS, seed)
        x, z = x[rows], z[rows]
        h = fit_hyperparameters(
            x, z, self.kernel, LEAST_NUGGET, START_ITERATIONS, 1, seed, self.parameters.blocks
        )
        model = self._model(joint=True)
        model.covar_module, model.likelihood = h.covar_module, h.likelihood
        if model.network is not None:
            random = networks.build([x.shape[1], *self.settings["hidden"], x.shape[1]], seed)
            # Zero last weights: training starts from the GP without a network.
            for own, layer in zip(model.network[:-1:2], random[:-1:2], strict=True):
                own.weight.data.copy_(layer.weight.T)
            model.train_on(x, z, model.state_dict(), START_ITERATIONS)
        return model.state_dict()

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
        return self._train(self._nearest(target, torch.arange(len(self.scores))))

    def _nearest(self, target, rows) -> torch.Tensor:
        """Places in `rows` of the simulations nearest to the standardised outputs `target`."""
        distance = (self.scores[rows] @ self.to_outputs.T - target).square().sum(1)
        return distance.topk(self.settings["neighbours"], largest=False).indices.sort().values

    def _train(self, rows: torch.Tensor) -> "LocalGP":
        """This emulator, trained on the simulations `rows`."""
        trained = copy.copy(self)
        trained._set_local(rows, self.start, self.settings["iterations"])
        return trained

    def _set_local(self, rows, start: dict, iterations: int) -> None:
        """Make the model of the simulations `rows`."""
        self.rows, self.local = rows, self._model(self.joint)
        self.local.train_on(self.inputs[rows], self.scores[rows], start, iterations)
        self.local.prepare()

    # ---------------------------------------------------------------------------- predicting

    def _localised(self) -> LocalModel:
        """The local fit. Raises InputError before `localise`."""
        if self.local is None:
            raise InputError(
                f"{self.name}: a local emulator predicts for one observation; call localise(y) "
                "with its outputs and use what that returns"
            )
        return self.local

    def _mean(self, x):
        return self._localised().mean(x)

    def _mean_jacobian(self, x):
        return self._localised().mean_jacobian(x)

    def _covariance(self, x):
        return self.variance_factor * self._localised().covariance(x)

    # ------------------------------------------------------------------------------- keeping

    def _state(self):
        if self.local is None:
            return super()._state()
        local = {"rows": self.rows, "parameters": self.local.state_dict()}
        return super()._state() | {"local": local}

    def _restore(self, state):
        super()._restore({"local": None} | state)
        if self.local is not None:
            self._set_local(self.local["rows"], self.local["parameters"], iterations=0)


class LocalSingleGP(LocalGP):
    """L.GP of the paper. Settings: neighbours, kernel, iterations of a local fit."""

    name = "local_gp"
    joint = False


class LocalMultiGP(LocalGP):
    """L.MGP of the paper. Settings: neighbours, kernel, iterations of a local fit."""

    name = "local_mgp"
    joint = True


class LocalDeepKernelGP(LocalGP):
    """L.DKGP of the paper.

    Settings: neighbours, kernel, iterations of a local fit, hidden (widths of the network).
    """

    name = "local_dkgp"
    joint = False


class LocalDeepKernelMultiGP(LocalGP):
    """L.DKMGP of the paper.

    Settings: neighbours, kernel, iterations of a local fit, hidden (widths of the network).
    """

    name = "local_dkmgp"
    joint = True
