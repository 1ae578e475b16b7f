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
from sklearn.linear_model import BayesianRidge

FEWEST = 4
"""Simulations of a set that converged, without which nothing is confirmed."""

LEAST_FREEDOM = 1e-3
"""Of one minus the leverage of a simulation: what is nearer to nothing is round-off."""

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

        Every output by Bayesian ridge regression, whose evidence says how much of the difference
        is linear. The covariance is that of each simulation left out: with fewer simulations than
        coordinates what remains at the others is next to nothing.
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
            left = np.empty((len(z), d))
            for output in range(d):
                y = difference[:, heart, output].numpy()
                unit = float(y.std()) or 1.0  # the priors of the regression have units
                found = BayesianRidge().fit(z.numpy(), y / unit)
                value[heart, output] = unit * float(found.intercept_)
                coefficients = unit * torch.as_tensor(found.coef_)
                slopes[heart, output, moved] = coefficients / sd[heart, moved]
                left[:, output] = unit * _left_out(found, z.numpy(), y / unit)
            covariance[heart] = torch.diag(torch.as_tensor(np.square(left).mean(0)))
        return cls(centre, value, slopes[..., :p], slopes[..., p:], covariance, len(outputs))


def _left_out(ridge: BayesianRidge, z: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Residuals (n,) of a ridge regression at each point when it is left out, for z (n, q) of
    mean zero and as much regularisation."""
    gram = z.T @ z + ridge.lambda_ / ridge.alpha_ * np.eye(z.shape[1])
    leverage = np.einsum("nq,qn->n", z, np.linalg.solve(gram, z.T)) + 1 / len(z)
    return (y - ridge.predict(z)) / np.maximum(1 - leverage, LEAST_FREEDOM)


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
