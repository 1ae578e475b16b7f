"""Confirmation of sets of causes by simulation, with all their effects at once.

Differences of single causes add up in the emulator; in the simulator they interact. So the leading
sets are simulated at draws of their posterior, and what the emulator gets wrong there is fitted, by
a linear function of log theta and psi, and taken away. Simulations bring their derivatives about
theta along, so that a handful of them says how that function depends on it.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from sklearn.covariance import OAS
from sklearn.linear_model import RidgeCV

from regional_lv.criticism.designs import label, slope_of

FEWEST = 4
"""Simulations of a set that converged, without which nothing is confirmed."""

PENALTIES = np.logspace(-2, 4, 13)
"""Of the slopes, for standardised coordinates: from next to none to nothing but a constant."""

LEAST_SPREAD = 1e-9
"""Of a coordinate over the draws, below which it counts as constant."""

LEAST_STEP = 0.01
"""Share of the range of psi that counts as one sd of the simulated values at least: over less than
that nothing is extrapolated, however close together they are."""


@dataclass(frozen=True)
class Correction:
    """What simulations of one set add to its emulated outputs, and how well that is known.

    A linear function of log theta and psi on its scale: `centre` (S, P + k) and the value there (S,
    D), derivatives by_log_theta (S, D, P) and by_scaled (S, D, k), covariance (S, D, D) of what
    remains. spread: sds (S, k) of scaled psi over the simulations. simulations: how many it was
    fitted to.
    """

    centre: torch.Tensor
    value: torch.Tensor
    by_log_theta: torch.Tensor
    by_scaled: torch.Tensor
    covariance: torch.Tensor
    spread: torch.Tensor
    simulations: int

    def beyond(self, scaled: torch.Tensor, width: torch.Tensor) -> torch.Tensor:
        """How far scaled psi (S, k) is from the mean of those that were simulated, in their sds.

        width: (k,) of the ranges.
        """
        mean = self.centre[:, -scaled.shape[-1] :]
        return (scaled - mean) / torch.maximum(self.spread, LEAST_STEP * width)

    def mean(self, theta: torch.Tensor, scaled: torch.Tensor) -> torch.Tensor:
        """(..., S, D) at theta (..., S, P) and scaled psi (..., S, k)."""
        away = torch.cat([theta.log(), scaled], dim=-1) - self.centre
        slopes = torch.cat([self.by_log_theta, self.by_scaled], dim=-1)
        return self.value + (slopes @ away[..., None])[..., 0]

    @classmethod
    def fit(cls, emulator, theta, scaled, outputs, slopes) -> "Correction":
        """From n simulations: theta (n, S, P), scaled psi (n, S, k), k > 0, outputs (n, S, D) and
        their derivatives about log theta, slopes (n, S, D, P), for `emulator` (an
        `ExtendedEmulator` without a correction).

        About theta the differences have the mean of their derivatives. What is left is fitted about
        psi, every output by ridge regression with the penalty that predicts left-out simulations
        best. The covariance is that of simulations left out of the whole fit, penalty included.
        What an emulator misses it misses in many channels alike, which is why their correlations
        count.
        """
        mean, emulated, _ = emulator.linearise(theta, scaled)
        difference, steeper = outputs - mean, slopes - emulated
        away = theta.log() - theta.log().mean(0)
        sd = scaled.std(0)
        z = torch.where(sd > LEAST_SPREAD, (scaled - scaled.mean(0)) / sd, 0.0)
        value, by_scaled, covariance = [], [], []
        for heart in range(outputs.shape[1]):
            parts = (z, away, difference, steeper)
            own = _Simulated(*(part[:, heart].numpy() for part in parts))
            found = own.fit(np.arange(len(outputs)))
            value.append(found.intercept_)
            by_scaled.append(found.coef_ / sd[heart].clamp(min=LEAST_SPREAD).numpy())
            covariance.append(_second_moments(own.left_out()))
        return cls(
            torch.cat([theta.log(), scaled], dim=-1).mean(0),
            torch.as_tensor(np.stack(value)),
            steeper.mean(0),
            torch.as_tensor(np.stack(by_scaled)),
            torch.as_tensor(np.stack(covariance)),
            sd,
            len(outputs),
        )


@dataclass(frozen=True)
class _Simulated:
    """What n simulations say of one heart: z (n, k) standardised psi, away (n, P) log theta from
    its mean, difference (n, D) from the emulator, and its derivatives steeper (n, D, P)."""

    z: np.ndarray
    away: np.ndarray
    difference: np.ndarray
    steeper: np.ndarray

    def fit(self, used: np.ndarray) -> RidgeCV:
        """Regression about psi, of simulations with the numbers `used`."""
        penalised = RidgeCV(alphas=PENALTIES, alpha_per_target=True)
        return penalised.fit(self.z[used], self._without_theta(used)[used])

    def left_out(self) -> np.ndarray:
        """Errors (n, D) at each simulation of a fit to the others."""
        left, numbers = np.empty_like(self.difference), np.arange(len(self.z))
        for i in numbers:
            used = numbers[numbers != i]
            predicted = self.fit(used).predict(self.z[[i]])[0]
            left[i] = self._without_theta(used)[i] - predicted
        return left

    def _without_theta(self, used: np.ndarray) -> np.ndarray:
        """Differences (n, D), without what theta does by the mean derivative of the `used`."""
        return self.difference - self.away @ self.steeper[used].mean(0).T


def _second_moments(residuals: np.ndarray) -> np.ndarray:
    """Second moments (d, d) of residuals (n, d): mean squares as they are, and correlations shrunk
    towards none as far as so few rows ask for (doi:10.1109/TSP.2010.2053029)."""
    rms = np.sqrt(np.square(residuals).mean(0))
    scaled = residuals / np.where(rms > 0, rms, 1.0)
    return rms[:, None] * OAS(assume_centered=True).fit(scaled).covariance_ * rms


def correct(
    model, members: Sequence[tuple[str, str]], simulations: pd.DataFrame, emulator=None
) -> Correction | None:
    """The `Correction` of one set from all simulations made of it; None if too few converged.

    model: the set's. emulator: an `ExtendedEmulator` with the set's extensions and without a
    correction, whose outputs are corrected; the model's if None.
    """
    emulator = emulator or model.emulator
    own = simulations[simulations["set"] == label(members)]
    if own.empty:
        return None
    subjects, outputs = model.observations.subjects, list(emulator.outputs)
    parameters = list(model.layout.parameters.names)
    # Rows of one draw belong together; numbers start anew in every round.
    own = own.assign(number=own.groupby("subject").cumcount())
    good = own.dropna(subset=outputs).groupby("number").filter(lambda g: len(g) == len(subjects))
    if good["number"].nunique() < FEWEST:
        return None
    good = good.assign(heart=good["subject"].map(subjects.index)).sort_values(["number", "heart"])
    shape = good["number"].nunique(), len(subjects)
    scales = {e.hypothesis.name: e.hypothesis.scale for e in emulator.extensions}
    scaled = [
        [scales[name](value) for name, (value, _) in json.loads(text).items()]
        for text in good["effects"]
    ]

    def tensor(values):
        return torch.as_tensor(np.asarray(values, dtype=float)).reshape(*shape, -1)

    theta, simulated = (tensor(good[names].to_numpy()) for names in (parameters, outputs))
    by_output = np.stack([np.stack(good[slope_of(output)]) for output in outputs], axis=1)
    slopes = torch.as_tensor(by_output).reshape(*shape, *by_output.shape[1:])
    return Correction.fit(emulator, theta, tensor(scaled), simulated, slopes)
