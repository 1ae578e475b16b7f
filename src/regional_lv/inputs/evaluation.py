"""Outputs as a function of all inputs of a study, from those of the inputs that are simulated.

Closed forms change the values at which outputs are looked up, and what is reported; a direction
changes the inputs that it moves.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import torch

from regional_lv.channels import Channels
from regional_lv.inputs.base import Input
from regional_lv.inputs.closed_forms import ClosedForm
from regional_lv.inputs.space import Inputs

Evaluate = Callable[[torch.Tensor], tuple[torch.Tensor, torch.Tensor]]
"""From values (M, k) of the simulated inputs to outputs (M, D) and their derivatives (M, D, k)
about these values, as `Emulator.linearise`, or the covariance (M, D, D) of their errors."""

Mean = Callable[[torch.Tensor], torch.Tensor]
"""The outputs alone, as `Emulator.predict_mean`."""


def carry(
    direction: Input,
    at: int,
    x: torch.Tensor,
    inputs: Iterable[Input],
    there: torch.Tensor,
    by_x: torch.Tensor | None,
) -> None:
    """Let a direction, which is number `at` of the values x (M, K), move those of E `inputs` that
    it moves: their values `there` (M, E), and, if asked for, derivatives `by_x` (M, E, K) of these
    about x. Both change in place."""
    for k, each in enumerate(inputs):
        if each.name in direction.moves:
            there[:, k], by_own, by_it = direction.carry(each, there[:, k], x[:, at])
            if by_x is not None:
                by_x[:, k] *= by_own[:, None]
                by_x[:, k, at] += by_it


def _alone(mean: Mean) -> Callable[[torch.Tensor], tuple[torch.Tensor]]:
    return lambda at: (mean(at),)


class AllInputs:
    """What closed forms and directions make of an emulator of the simulated inputs.

    inputs: all K of a study. channels: the D outputs.
    """

    def __init__(self, inputs: Inputs, channels: Channels):
        self.inputs, self.channels = inputs, channels
        self.simulated = np.flatnonzero(inputs.are_simulated)
        self._forms = [(j, e) for j, e in enumerate(inputs) if isinstance(e, ClosedForm)]
        looked_up = np.array([form.concerned(channels) for _, form in self._forms])
        looked_up = looked_up.reshape(len(self._forms), len(channels))
        patterns = [
            (pattern, np.flatnonzero((looked_up == pattern[:, None]).all(axis=0)))
            for pattern in np.unique(looked_up, axis=1).T
        ]
        self._patterns = sorted(patterns, key=lambda each: -len(each[1]))
        self._powers = np.array([[form.power(each) for each in inputs] for _, form in self._forms])
        reported = [(j, form.reported(channels)) for j, form in self._forms]
        self._reported = [(j, torch.as_tensor(powers)) for j, powers in reported if powers.any()]

    def looked_up(
        self, x: torch.Tensor, pattern: np.ndarray, by_x: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Values (M, K) at which the simulator has outputs that a `pattern` of the closed forms
        concerns, at x (M, K).

        by_x: unit matrices (M, K, K), which become the derivatives of these values with respect to
        x."""
        there = x.clone()
        for j, direction in self.inputs.directions:
            carry(direction, j, x, self.inputs, there, by_x)
        for (j, form), powers, concerned in zip(self._forms, self._powers, pattern, strict=True):
            if not concerned or not powers.any():
                continue
            share, slope = form.share(x[:, j])
            factor = share[:, None] ** -torch.as_tensor(powers, dtype=x.dtype)
            there = there * factor
            if by_x is not None:
                by_x *= factor[..., None]
                by_x[:, :, j] -= torch.as_tensor(powers) * there * (slope / share)[:, None]
        return there

    def __call__(self, evaluate: Evaluate, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Outputs (M, D) at values x (M, K), and their derivatives (M, D, K) with respect to the
        scaled coordinates. Channels that are looked up at the same values are evaluated
        together."""
        count, size = len(self.channels), x.shape[1]
        values, slopes = x.new_empty(len(x), count), x.new_empty(len(x), count, size)
        by_x = torch.eye(size, dtype=x.dtype).repeat(len(self._patterns), len(x), 1, 1)
        looked_up = [
            self.looked_up(x, pattern, change)
            for (pattern, _), change in zip(self._patterns, by_x, strict=True)
        ]
        found = self._evaluated(evaluate, evaluate, looked_up)
        for (_, rows), change, (value, gradient) in zip(self._patterns, by_x, found, strict=True):
            values[:, rows] = value[:, rows]
            slopes[:, rows] = gradient[:, rows] @ change[:, self.simulated]
        factor = self.factor(x)
        values, slopes = values * factor, slopes * factor[..., None]
        for j, power in self._reported:
            slopes[:, :, j] += values * power / x[:, j, None]
        return values, slopes * self.inputs.coordinates.slope(x)[:, None]

    def values(self, mean: Mean, x: torch.Tensor) -> torch.Tensor:
        """Outputs (M, D) alone at values x (M, K), from those (M, D) of the simulated inputs."""
        alone = _alone(mean)
        return self._values(alone, alone, x)[0]

    def predict(
        self, evaluate: Evaluate, mean: Mean, x: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """The same and the covariance (M, D, D) of their errors, from both of the simulated inputs.
        All errors are those where most of the channels are looked up: elsewhere the `mean` will do.
        """
        values, ((_, covariance), *_) = self._values(evaluate, _alone(mean), x)
        factor = self.factor(x)
        return values, factor[:, :, None] * covariance * factor[:, None]

    def _values(self, evaluate, again, x):
        """Outputs (M, D), and what `_evaluated` returns, outputs first."""
        values = x.new_empty(len(x), len(self.channels))
        looked_up = [self.looked_up(x, pattern) for pattern, _ in self._patterns]
        found = self._evaluated(evaluate, again, looked_up)
        for (_, rows), (value, *_) in zip(self._patterns, found, strict=True):
            values[:, rows] = value[:, rows]
        return values * self.factor(x), found

    def _evaluated(self, evaluate, again, looked_up: Sequence[torch.Tensor]) -> list:
        """What `evaluate` returns at the values (M, K) of the first pattern, and of each other one
        what `again` does, the first of the same. A point is evaluated again only where a closed
        form is at work, which in most models is nowhere."""
        first, *others = looked_up
        found = [evaluate(first[:, self.simulated])]
        for there in others:
            moved, own = (there != first).any(dim=1), found[0]
            if moved.any():
                changed = again(there[moved][:, self.simulated])
                own = tuple(
                    old.index_put((moved,), new)
                    for old, new in zip(own[: len(changed)], changed, strict=True)
                )
            found.append(own)
        return found

    def most_looked_up(self, x: torch.Tensor) -> torch.Tensor:
        """Values (M, k) of the simulated inputs at which most of the channels are looked up."""
        return self.looked_up(x, self._patterns[0][0])[:, self.simulated]

    def factor(self, x: torch.Tensor) -> torch.Tensor:
        """What outputs (M, D) that are looked up are multiplied by at values x (M, K)."""
        found = torch.ones(len(x), len(self.channels), dtype=x.dtype)
        for j, power in self._reported:
            found = found * x[:, j, None] ** power
        return found
