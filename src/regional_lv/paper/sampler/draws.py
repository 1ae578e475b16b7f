"""What samplers are asked for and what they hand back."""

import math
from dataclasses import dataclass

import numpy as np
import torch

from regional_lv.paper.sampler.diagnostics import check_convergence


@dataclass(frozen=True)
class Settings:
    """Section `nuts` of the config."""

    chains: int = 2
    warmup: int = 300
    draws: int = 600
    target_accept: float = 0.8
    max_tree_depth: int = 10
    rhat_max: float = 1.01
    ess_min: float = 400.0

    @classmethod
    def from_config(cls, nuts: dict) -> "Settings":
        """Read the section; its keys that are no setting of the sampler are left aside."""
        return cls(**{key: nuts[key] for key in cls.__dataclass_fields__ if key in nuts})

    @property
    def total(self) -> int:
        """Draws of all chains."""
        return self.chains * self.draws


@dataclass(frozen=True)
class Draws:
    """One posterior, by either sampler.

    theta (chain, draw, P); sigma (chain, draw, G), in training sd; energy (-log density in the
    sampler's coordinates, exact within `importance.EVEN`), acceptance_rate (1 of independent
    draws), diverging: (chain, draw). pareto_k: shape of the tail of the importance weights; NaN if
    these are even. weighted_ess: effective sample size that the weights leave. seconds: wall time.
    """

    theta: np.ndarray
    sigma: np.ndarray
    acceptance_rate: np.ndarray
    diverging: np.ndarray
    energy: np.ndarray
    pareto_k: float
    weighted_ess: float
    seconds: float = math.nan

    @classmethod
    def of(
        cls,
        drawn: tuple[torch.Tensor, torch.Tensor],
        energy: torch.Tensor,
        diverging: np.ndarray,
        **rest,
    ) -> "Draws":
        """From theta (N, P) and log sigma (N, G), chain after chain, and energy (N,); the others
        as they are."""
        theta, log_sigma = drawn
        shape = diverging.shape
        return cls(
            theta=theta.reshape(*shape, -1).numpy(),
            sigma=log_sigma.exp().reshape(*shape, -1).numpy(),
            energy=energy.reshape(shape).numpy(),
            diverging=diverging,
            **rest,
        )

    def verdict(self, settings: Settings) -> str:
        """`passed`, or `failed:` and what did not pass."""
        chains = np.concatenate([self.theta, self.sigma], axis=-1)
        return check_convergence(
            chains,
            [str(i) for i in range(chains.shape[-1])],
            self.diverging,
            settings.rhat_max,
            settings.ess_min,
            self.pareto_k,
            self.weighted_ess,
        )[1]
