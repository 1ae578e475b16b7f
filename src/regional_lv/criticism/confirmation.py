"""Confirmation of sets of causes by simulation, with all their effects at once.

Differences of single causes add up in the emulator; in the simulator they interact. So the leading
sets are simulated at draws of their posterior, and what the emulator gets wrong there is fitted, by
a linear function of log theta and psi, and taken away.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from sklearn.covariance import OAS
from sklearn.linear_model import RidgeCV

FEWEST = 4
"""Simulations of a set that converged, without which nothing is confirmed."""

PENALTIES = np.logspace(-2, 4, 13)
"""Of the slopes, for standardised coordinates: from next to none to nothing but a constant."""

LEAST_SPREAD = 1e-9
"""Of a coordinate over the draws, below which it counts as constant."""


@dataclass(frozen=True)
class Correction:
    """What simulations of one set add to its emulated outputs, and how well that is known.

    A linear function of log theta and psi on its scale: `centre` (S, P + k) and the value there (S,
    D), derivatives by_log_theta (S, D, P) and by_scaled (S, D, k), covariance (S, D, D) of what
    remains. simulations: how many it was fitted to.
    """

    centre: torch.Tensor
    value: torch.Tensor
    by_log_theta: torch.Tensor
    by_scaled: torch.Tensor
    covariance: torch.Tensor
    simulations: int

    def mean(self, theta: torch.Tensor, scaled: torch.Tensor) -> torch.Tensor:
        """(..., S, D) at theta (..., S, P) and scaled psi (..., S, k)."""
        away = torch.cat([theta.log(), scaled], dim=-1) - self.centre
        slopes = torch.cat([self.by_log_theta, self.by_scaled], dim=-1)
        return self.value + (slopes @ away[..., None])[..., 0]

    @classmethod
    def fit(cls, emulator, theta, scaled, outputs) -> "Correction":
        """From n simulations: theta (n, S, P), scaled psi (n, S, k), outputs (n, S, D) for
        `emulator` (an `ExtendedEmulator` without a correction).

        Every output by ridge regression, with the penalty that predicts left-out simulations best.
        The covariance is that of simulations left out of the whole fit, penalty included: with
        fewer simulations than coordinates a line goes through all of them. What an emulator misses
        it misses in many channels alike, which is why their correlations count.
        """
        difference = outputs - emulator.mean(theta, scaled)
        at = torch.cat([theta.log(), scaled], dim=-1)
        centre, sd = at.mean(0), at.std(0)
        (s, d), p = outputs.shape[1:], theta.shape[-1]
        value, slopes = torch.zeros(s, d).double(), torch.zeros(s, d, at.shape[-1]).double()
        covariance = torch.zeros(s, d, d).double()
        for heart in range(s):
            moved = sd[heart] > LEAST_SPREAD
            z = ((at[:, heart] - centre[heart]) / sd[heart].clamp(min=LEAST_SPREAD))[:, moved]
            found = _ridge(z.numpy(), difference[:, heart].numpy())
            value[heart] = torch.as_tensor(found.intercept_)
            slopes[heart][:, moved] = torch.as_tensor(found.coef_) / sd[heart, moved]
            left = _left_out(z.numpy(), difference[:, heart].numpy())
            covariance[heart] = torch.as_tensor(_second_moments(left))
        return cls(centre, value, slopes[..., :p], slopes[..., p:], covariance, len(outputs))


def _ridge(z: np.ndarray, y: np.ndarray) -> RidgeCV:
    """Ridge regression of outputs y (n, d) on z (n, q), each with a penalty of its own."""
    return RidgeCV(alphas=PENALTIES, alpha_per_target=True).fit(z, y)


def _left_out(z: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Errors (n, d) of regressions of y (n, d) on z (n, q), each at the row that it did without."""
    left = np.empty_like(y)
    for i in range(len(z)):
        others = np.arange(len(z)) != i
        left[i] = y[i] - _ridge(z[others], y[others]).predict(z[[i]])[0]
    return left


def _second_moments(residuals: np.ndarray) -> np.ndarray:
    """Second moments (d, d) of residuals (n, d): mean squares as they are, and correlations shrunk
    towards none as far as so few rows ask for (doi:10.1109/TSP.2010.2053029)."""
    rms = np.sqrt(np.square(residuals).mean(0))
    scaled = residuals / np.where(rms > 0, rms, 1.0)
    return rms[:, None] * OAS(assume_centered=True).fit(scaled).covariance_ * rms


# ------------------------------------------------------------------------------------- design


def design_columns(parameters: Sequence[str]) -> list[str]:
    """Columns of a table of simulations to make; of `design_rows`."""
    return ["set", "draw", "subject", *parameters, "effects"]


def design_rows(members: Sequence[tuple[str, str]], model, draws: torch.Tensor) -> list[dict]:
    """Simulations to make: one per draw x (n, P) of `model` and heart.

    members: name and component of the model's extensions. A row has the `design_columns`;
    `effects` is JSON: name -> [value, component].
    """
    theta, psi = model.theta(draws), model.psi_of(draws)
    names = model.layout.parameters.names
    return [
        {
            "set": label(members),
            "draw": draw,
            "subject": subject,
            **dict(zip(names, theta[draw, heart].tolist(), strict=True)),
            "effects": json.dumps(
                {
                    name: [float(value), component]
                    for (name, component), value in zip(members, psi[draw, heart], strict=True)
                }
            ),
        }
        for draw in range(len(draws))
        for heart, subject in enumerate(model.observations.subjects)
    ]


def label(members: Sequence[tuple[str, str]]) -> str:
    """`focal_scar:7 + septal_load`; for no cause an empty text."""
    return " + ".join(f"{n}:{c}" if c else n for n, c in members)


def correct(model, members: Sequence[tuple[str, str]], simulations: pd.DataFrame):
    """The `Correction` of one set from all simulations made of it; None if too few converged.

    model: the set's, without a correction.
    """
    own = simulations[simulations["set"] == label(members)]
    if own.empty:
        return None
    subjects, outputs = model.observations.subjects, list(model.emulator.outputs)
    parameters = list(model.layout.parameters.names)
    # Rows of one draw belong together; numbers start anew in every round.
    own = own.assign(number=own.groupby("subject").cumcount())
    good = own.dropna(subset=outputs).groupby("number").filter(lambda g: len(g) == len(subjects))
    if good["number"].nunique() < FEWEST:
        return None
    good = good.assign(heart=good["subject"].map(subjects.index)).sort_values(["number", "heart"])
    shape = good["number"].nunique(), len(subjects)
    scales = {e.hypothesis.name: e.hypothesis.scale for e in model.emulator.extensions}
    scaled = [
        [scales[name](value) for name, (value, _) in json.loads(text).items()]
        for text in good["effects"]
    ]

    def tensor(values):
        return torch.as_tensor(np.asarray(values, dtype=float)).reshape(*shape, -1)

    theta, simulated = (tensor(good[names].to_numpy()) for names in (parameters, outputs))
    return Correction.fit(model.emulator, theta, tensor(scaled), simulated)
