"""DGP: two layers of sparse variational Gaussian processes."""

import math

import torch

from regional_lv.emulators.base import Architecture
from regional_lv.emulators.kernels import correlation
from regional_lv.emulators.optimise import lbfgs
from regional_lv.emulators.reduced import row_jacobian
from regional_lv.emulators.shared_kernel import subset
from regional_lv.emulators.variational import BOUNDS, JITTER, VariationalGP
from regional_lv.seeds import derive

COPIES = 2
"""Places at which each simulation's hidden variables are tried in training, mirror images."""

DRAWS = 8
"""Fixed draws of the hidden variables that predictions average over, half of them mirrored."""

HIDDEN_BOUNDS = {
    "hidden_points": None,
    "hidden_length_scales": (-3.0, 6.0),
    "hidden_alpha": (-3.0, 5.0),
    "hidden_sd": (-10.0, 2.0),
    "hidden_mean": None,
    "hidden_spread": (-15.0, 1.0),
}


class DGP(VariationalGP):
    """Deep GP of the paper: scores are independent GPs of P hidden variables, and these are GPs
    of the inputs, around the inputs themselves (Salimbeni and Deisenroth 2017, arXiv:1705.08933).

    The first layer's q(u) is Gaussian, independent between whitened inducing values, the second's
    is at its optimum (`variational`). The bound's expectation over the hidden variables is taken
    over fixed draws, which makes it a deterministic objective; training starts from a VGP, the
    case of hidden variables that are the inputs. Settings: those of VGP, deep_iterations.
    """

    name = "dgp"
    architecture = Architecture(
        "DGP", "variational GP", "global", "multi-output", "variational GP layers"
    )
    mixed = False
    _KEYS = (*VariationalGP._KEYS, "hidden", "draws")

    def _fit_scores(self, x, z, seed):
        self.hidden = None
        super()._fit_scores(x, z, seed)
        rows = subset(len(x), self.settings["hyperparameter_rows"], seed)
        generator = torch.Generator().manual_seed(derive(seed, "draws"))
        first = self._first_layer(x.shape[1])
        keys = [*BOUNDS, *first]
        half = torch.randn(len(x), x.shape[1], generator=generator, dtype=x.dtype)
        draws = torch.stack([half, -half])

        def split(values):
            both = dict(zip(keys, values, strict=True))
            return {k: both[k] for k in BOUNDS}, {k: both[k] for k in first}

        def loss(values):
            second, hidden = split(values)
            places = self._hide(hidden, x[rows], draws[:, rows])
            bound = self._loss(second, places, z[rows].repeat(COPIES, 1), COPIES)
            return bound + self._divergence(hidden) / z[rows].numel()

        found, bound = lbfgs(
            loss,
            [*(self.variational[k] for k in BOUNDS), *first.values()],
            [*BOUNDS.values(), *HIDDEN_BOUNDS.values()],
            self.settings["deep_iterations"],
        )
        self.variational, self.hidden = split(found)
        places = self._hide(self.hidden, x, draws)
        self.solution = self._solve(self.variational, places, z.repeat(COPIES, 1), COPIES)
        half = torch.randn(DRAWS // 2, 1, x.shape[1], generator=generator, dtype=x.dtype)
        self.draws = torch.cat([half, -half])
        self.info |= {
            "bound_per_number": -bound,
            "hidden_sd": self.hidden["hidden_sd"].exp().tolist(),
            "noise": self.variational["noise"].exp().tolist(),
        }

    def _first_layer(self, width: int) -> dict[str, torch.Tensor]:
        """Hidden variables that are the inputs, but for a little."""
        points = self.variational["points"]
        scales = self.variational["length_scales"].mean(0)
        full = torch.full((width, len(points)), 0.0, dtype=points.dtype)
        return {
            "hidden_points": points.clone(),
            "hidden_length_scales": scales.repeat(width, 1),
            "hidden_alpha": self.variational["alpha"].mean().repeat(width),
            "hidden_sd": torch.full((width,), math.log(0.1), dtype=points.dtype),
            "hidden_mean": full,
            "hidden_spread": full - 4.0,
        }

    def _hide(self, p, x, draws) -> torch.Tensor:
        """Hidden variables (S N, P) of `x` (N, P) at standard normal `draws` (S, N or 1, P)."""
        mean, sd = self._hidden_moments(p, x)
        return (mean + sd * draws).reshape(-1, x.shape[1])

    def _hidden_moments(self, p, x) -> tuple[torch.Tensor, torch.Tensor]:
        points, scales = p["hidden_points"], p["hidden_length_scales"].exp()
        alpha = p["hidden_alpha"].exp()
        eye = torch.eye(len(points), dtype=x.dtype)
        matrix = correlation(self.kernel, points, points, scales, alpha) + JITTER * eye
        cross = correlation(self.kernel, points, x, scales, alpha)
        a = torch.linalg.solve_triangular(torch.linalg.cholesky(matrix), cross, upper=False)
        mean = (p["hidden_mean"][:, None] @ a)[:, 0].T
        shrink = 1 - (2 * p["hidden_spread"]).exp()[..., None]
        variance = (1 - (shrink * a.square()).sum(1)).clamp(min=JITTER).T
        sd = p["hidden_sd"].exp()
        return x + sd * mean, sd * variance.sqrt()

    @staticmethod
    def _divergence(p) -> torch.Tensor:
        """Of the first layer's q(u) from its prior (Kullback-Leibler)."""
        spread = p["hidden_spread"]
        return 0.5 * ((2 * spread).exp() + p["hidden_mean"].square() - 1 - 2 * spread).sum()

    # ---------------------------------------------------------------------------- predicting

    def _parts(self, x, function) -> torch.Tensor:
        """What the second layer's `function` gives at each draw, (S, M, K)."""
        values = function(self._hide(self.hidden, x, self.draws))
        return values.reshape(len(self.draws), len(x), -1)

    def _mean(self, x):
        return self._parts(x, super()._mean).mean(0)

    def _mean_jacobian(self, x):
        inner = row_jacobian(lambda at: self._hide(self.hidden, at, self.draws), x)
        outer = super()._mean_jacobian(self._hide(self.hidden, x, self.draws))
        each = (outer @ inner).reshape(len(self.draws), len(x), -1, x.shape[1])
        return each.mean(0)

    def _covariance(self, x):
        apart = self._parts(x, super()._mean)
        apart = (apart - apart.mean(0)).permute(1, 0, 2)
        within = self._parts(x, super()._covariance).mean(0)
        return torch.diag_embed(within) + apart.mT @ apart / len(self.draws)
