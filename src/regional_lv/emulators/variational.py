"""Sparse variational Gaussian processes: latent processes, mixed into the scores.

Scores y_k = sum_q W_kq g_q(x) + noise of variance s_k, g_q ~ GP(0, K_q). At M inducing points Z,
g_q = L_q u_q with K_q(Z, Z) = L_q L_q' (whitening), and q(u) = prod_q N(m_q, S_q). The lower bound
on the evidence is (Hensman et al. 2015, arXiv:1411.2005; Alvarez and Lawrence 2011 for the mixing)

    sum_k [-N/2 log(2 pi s_k) - |y_k - (W mu)_k|^2 / (2 s_k)]
    - 1/2 sum_q [beta_q (N - |A_q|^2) + log|H_q| + |m_q|^2],

with A_q = L_q^-1 K_q(Z, X), mu_q = A_q' m_q, beta_q = sum_k W_kq^2 / s_k and
H_q = I + beta_q A_q A_q', once S_q = H_q^-1 is put in, its optimum (Titsias 2009, for one output).
The optimal m solves a linear system. What is left to optimise, length scales, mixing, noise and
inducing points, has a smooth deterministic objective: natural gradients with step one for q(u),
L-BFGS for the rest, instead of thousands of stochastic steps.
"""

import logging
import math

import torch

from regional_lv.emulators.kernels import correlation, mean_slopes
from regional_lv.emulators.optimise import lbfgs
from regional_lv.emulators.reduced import ReducedEmulator
from regional_lv.emulators.shared_kernel import cholesky, fit_hyperparameters, subset
from regional_lv.reduction import VOLUME
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

JITTER = 1e-7
"""On the diagonal of the inducing points' correlations, part of the model."""

START_ROWS, START_ITERATIONS = 500, 60
"""The exact GP with a shared kernel that gives the first length scales."""

CG_STEPS, CG_TOLERANCE = 60, 1e-8
"""Conjugate gradients for the means of coupled latent processes."""

BOUNDS = {
    "points": None,
    "length_scales": (-3.0, 6.0),
    "alpha": (-3.0, 5.0),
    "mixing": None,
    "noise": (math.log(1e-8), 1.0),
}
"""Of the parameters (all but points and mixing are logarithms)."""


class VariationalGP(ReducedEmulator):
    """Sparse variational GP on all simulations.

    mixed: latent processes are mixed by a full matrix (linear model of coregionalisation), or each
    score has its own. Settings: inducing (number of points, shared by the processes), kernel,
    iterations (L-BFGS), hyperparameter_rows (rows that the hyperparameters see; q(u) sees all).
    """

    mixed: bool
    _KEYS = ("kernel", "variational", "solution")

    def _fit_scores(self, x, z, seed):
        s = self.settings
        self.kernel = self._choose_kernel(x, z, JITTER, seed)
        rows = subset(len(x), s["hyperparameter_rows"], seed)
        keys = list(BOUNDS)
        start = self._start(x, z, seed)
        found, bound = lbfgs(
            lambda values: self._loss(dict(zip(keys, values, strict=True)), x[rows], z[rows]),
            [start[key] for key in keys],
            list(BOUNDS.values()),
            s["iterations"],
        )
        self.variational = dict(zip(keys, found, strict=True))
        self.solution = self._solve(self.variational, x, z)
        self.info |= {
            "hyperparameter_rows": len(rows),
            "inducing": len(self.variational["points"]),
            "bound_per_number": -bound,
            "noise": self.variational["noise"].exp().tolist(),
        }

    def _start(self, x, z, seed) -> dict[str, torch.Tensor]:
        """Inducing points by k-means, length scales of an exact GP, mixing by one score each."""
        latents = self._latents(z.shape[1])
        rows = subset(len(x), START_ROWS, derive(seed, "start"))
        h = fit_hyperparameters(
            x[rows], z[rows], self.kernel, JITTER, START_ITERATIONS, restarts=1, seed=seed
        )
        points = x
        if self.settings["inducing"] < len(x):
            from sklearn.cluster import KMeans  # slow to load, and every job loads this module

            means = KMeans(self.settings["inducing"], n_init=1, max_iter=50, random_state=seed)
            points = torch.as_tensor(means.fit((x / h.length_scales).numpy()).cluster_centers_)
            points = points * h.length_scales
        # A process may vary more than its N values do: the exact GP knows by how much.
        signal = self._signal(x[rows], z[rows], h)
        # With fewer processes than scores, the last ones have none at the start. Volumes stand last
        # and are no small components: without one, L-BFGS has to find them in those of others.
        components = z.shape[1] - int(self.channels.of_quantity(VOLUME).sum())
        order = [*range(components, z.shape[1]), *range(components)]
        mixing = torch.diag(signal)[:, order[:latents]] if self.mixed else signal.log()
        scales = h.length_scales.log().clamp(*BOUNDS["length_scales"])
        return {
            "points": points,
            "length_scales": scales.repeat(latents, 1),
            "alpha": torch.full((latents,), math.log(h.alpha), dtype=x.dtype),
            "mixing": mixing.clone(),
            "noise": torch.full((z.shape[1],), math.log(1e-2), dtype=x.dtype),
        }

    def _signal(self, x, z, h) -> torch.Tensor:
        """Standard deviation (K,) of the process of each score, from the exact GP."""
        alpha = torch.tensor([h.alpha], dtype=x.dtype)
        matrix = correlation(self.kernel, x, x, h.length_scales[None], alpha)[0]
        factor, _ = cholesky(matrix, h.nugget, self.name)
        return torch.linalg.solve_triangular(factor, z, upper=False).square().mean(0).sqrt()

    def _latents(self, scores: int) -> int:
        return min(self.settings["latents"], scores) if self.mixed else scores

    # ------------------------------------------------------------------------- the lower bound

    def _terms(self, p, x, copies):
        """W (K, Q), noise variances (K,), L (Q, M, M), A (Q, M, N), beta (Q,), chol H (Q, M, M)."""
        points, scales, alpha = p["points"], p["length_scales"].exp(), p["alpha"].exp()
        eye = torch.eye(len(points), dtype=x.dtype)
        w = p["mixing"] if self.mixed else torch.diag(p["mixing"].exp())
        noise = copies * p["noise"].exp()
        factor = torch.linalg.cholesky(
            correlation(self.kernel, points, points, scales, alpha) + JITTER * eye
        )
        cross = correlation(self.kernel, points, x, scales, alpha)
        a = torch.linalg.solve_triangular(factor, cross, upper=False)
        beta = (w.square() / noise[:, None]).sum(0)
        h = torch.linalg.cholesky(eye + beta[:, None, None] * (a @ a.mT))
        return w, noise, factor, a, beta, h

    def _loss(self, p, x, z, copies: int = 1) -> torch.Tensor:
        """Minus the lower bound per number in `z` (N, K), q(u) at its optimum.

        By the envelope theorem the optimum's own dependence on `p` does not matter for the
        gradient. copies: how often each observation stands in `x` and `z`, at different places,
        with as small a share of the likelihood.
        """
        w, noise, _, a, beta, h = self._terms(p, x, copies)
        with torch.no_grad():
            m = self._means(w, noise, a, h, z)
        fitted = (m[:, None] @ a)[:, 0].T @ w.T
        n = len(x)
        value = n / copies * (2 * math.pi * noise / copies).log().sum()
        value = value + ((z - fitted).square().sum(0) / noise).sum()
        value = value + (beta * (n - a.square().sum((1, 2)))).sum()
        value = value + 2 * h.diagonal(dim1=-2, dim2=-1).log().sum() + m.square().sum()
        return 0.5 * copies * value / z.numel()

    def _means(self, w, noise, a, h, z) -> torch.Tensor:
        """Optimal whitened means m (Q, M) of all latent processes together.

        H_q m_q + sum_q' c_qq' A_q A_q'' m_q' = A_q (z W / noise)_q over q' other than q, with
        c = W' diag(1/noise) W; conjugate gradients with the factors of H as preconditioner.
        """
        weighted = w / noise[:, None]
        coupling = w.T @ weighted

        def apply(m):
            return m + (a @ (coupling @ (m[:, None] @ a)[:, 0])[..., None])[..., 0]

        def precondition(r):
            return torch.cholesky_solve(r[..., None], h)[..., 0]

        right = (a @ (z @ weighted).T[..., None])[..., 0]
        m = precondition(right)
        if not self.mixed:
            return m
        residual = right - apply(m)
        step = preconditioned = precondition(residual)
        size, enough = (residual * preconditioned).sum(), CG_TOLERANCE * (right * m).sum()
        for _ in range(CG_STEPS):
            if size <= enough:
                break
            image = apply(step)
            rate = size / (step * image).sum()
            m, residual = m + rate * step, residual - rate * image
            preconditioned = precondition(residual)
            before, size = size, (residual * preconditioned).sum()
            step = preconditioned + size / before * step
        return m

    def _solve(self, p, x, z, copies: int = 1) -> dict[str, torch.Tensor]:
        """What predictions need: weights L^-T m (Q, M), L^-1 and R' L^-1 (Q, M, M), S = R R'."""
        w, noise, factor, a, _, h = self._terms(p, x, copies)
        m = self._means(w, noise, a, h, z)
        eye = torch.eye(a.shape[1], dtype=x.dtype).expand_as(factor)
        whiten = torch.linalg.solve_triangular(factor, eye, upper=False)
        return {
            "weights": (whiten.mT @ m[..., None])[..., 0],
            "whiten": whiten,
            "learnt": torch.linalg.solve_triangular(h, whiten, upper=False),
        }

    # ---------------------------------------------------------------------------- predicting

    def _cross(self, x) -> torch.Tensor:
        """(Q, N, M) correlations with the inducing points."""
        p = self.variational
        return correlation(self.kernel, x, p["points"], p["length_scales"].exp(), p["alpha"].exp())

    def _mean(self, x):
        latent = (self._cross(x) @ self.solution["weights"][..., None])[..., 0]
        mixing = self.variational["mixing"]
        return latent.T @ mixing.T if self.mixed else latent.T * mixing.exp()

    def _mean_jacobian(self, x):
        p = self.variational
        scales, alpha = p["length_scales"].exp(), p["alpha"].exp()
        weights = self.solution["weights"]
        latent = mean_slopes(self.kernel, x, p["points"], scales, alpha, weights).permute(1, 0, 2)
        return p["mixing"] @ latent if self.mixed else p["mixing"].exp()[:, None] * latent

    def _covariance(self, x):
        k = self._cross(x)
        known = (k @ self.solution["whiten"].mT).square().sum(-1)
        uncertain = (k @ self.solution["learnt"].mT).square().sum(-1)
        variance = (1 - known + uncertain).clamp(min=JITTER).T
        mixing, noise = self.variational["mixing"], self.variational["noise"].exp()
        if not self.mixed:
            return variance * mixing.exp().square() + noise
        return (mixing * variance[:, None, :]) @ mixing.T + torch.diag(noise)
