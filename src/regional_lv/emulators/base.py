"""The interface that every emulator has: fit, predict with covariance, save, load."""

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import torch

from regional_lv.channels import Channels
from regional_lv.config.sections.settings import settings_of
from regional_lv.emulators import least_simulations
from regional_lv.emulators.architecture import Architecture
from regional_lv.errors import InputError
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.stiffness import StiffnessInputs, from_spec, repeated

FORMAT = 6
"""Of emulator files: raised when what they hold changes."""

OUTSIDE_QUANTILE = 0.99
"""Of the training inputs' distances to their nearest neighbours: what is farther is outside."""


class Prediction:
    """Predictive distribution of the outputs, Gaussian, in their natural units.

    mean: (..., D). covariance: (..., D, D). Both differentiable with respect to theta.
    `variance`, `output_covariance` and `freedom`: of a `SeparablePrediction` alone.
    """

    variance: torch.Tensor
    output_covariance: torch.Tensor
    freedom: float

    def __init__(self, mean: torch.Tensor, covariance: torch.Tensor):
        self.mean = mean
        self._covariance = covariance

    @property
    def covariance(self) -> torch.Tensor:
        return self._covariance

    @property
    def sd(self) -> torch.Tensor:
        """Standard deviation of each output, (..., D)."""
        return self.covariance.diagonal(dim1=-2, dim2=-1).sqrt()


class SeparablePrediction(Prediction):
    """A prediction with covariance `variance` (...) times `output_covariance` (D, D).

    The likelihood diagonalises `output_covariance` once instead of factorising at every theta.

    freedom: nu of a multivariate t with this scale matrix, for errors of one simulation that are
    large or small together; infinite: Gaussian.
    """

    def __init__(
        self,
        mean: torch.Tensor,
        variance: torch.Tensor,
        output_covariance: torch.Tensor,
        freedom: float = math.inf,
    ):
        super().__init__(mean, output_covariance)
        self.variance, self.freedom = variance, freedom
        self.output_covariance = output_covariance

    @property
    def covariance(self) -> torch.Tensor:
        return self.variance[..., None, None] * self.output_covariance

    @property
    def sd(self) -> torch.Tensor:
        return torch.sqrt(self.variance[..., None] * self.output_covariance.diagonal())


def join(predictions: Sequence[Prediction]) -> Prediction:
    """One prediction (M, ...) out of several of the same emulator."""
    mean = torch.cat([one.mean for one in predictions])
    first = predictions[0]
    if isinstance(first, SeparablePrediction):
        return SeparablePrediction(
            mean,
            torch.cat([one.variance for one in predictions]),
            first.output_covariance,
            first.freedom,
        )
    return Prediction(mean, torch.cat([one.covariance for one in predictions]))


def row_jacobian(function: Callable[[torch.Tensor], torch.Tensor], x: torch.Tensor):
    """d(function)/dx (..., K, P) of a function of each row of `x` (M, P) by itself, whatever the
    order of the rows that it returns: one forward derivative for each of the P inputs."""

    def along(direction):
        return torch.func.jvp(function, (x,), (direction.expand_as(x),))[1]

    return torch.func.vmap(along, out_dims=-1)(torch.eye(x.shape[1], dtype=x.dtype))


@dataclass(frozen=True)
class TrainingSet:
    """What an emulator learns from, standardised: inputs `x` (N, P), outputs `y` (N, D), and
    `slopes` (N, D, P) = dy/dx for emulators that learn from sensitivities."""

    x: torch.Tensor
    y: torch.Tensor
    slopes: torch.Tensor | None = None


class Emulator(ABC):
    """A statistical surrogate of the simulator.

    After `fit` (or `load`): `parameters` (the P parameters theta), `outputs` (names of the D
    outputs), `channels` (the same as objects), `lower` and `upper` (P,), the bounds of the
    parameters, `output_mean` and `output_sd` (D,) of the training outputs in natural units, and
    `info`, what the fit has to say about itself.

    A new emulator is one file with a subclass that says its `name`, and one entry in
    `emulators.REGISTRY` that says its architecture. A plugin's class says its `architecture` itself
    and is added by `emulators.REGISTRY.add`. Its settings and their defaults are those of
    `config.sections.settings`; one that has no section there, such as a plugin's, names them with
    their defaults in the class attribute `defaults`, to which those of its base classes are added.
    It has to implement `_fit`, `_predict`, `_state`, `_restore` and `_select`, or less with
    `reduced.ReducedEmulator` as its base.

    Raises InputError for a setting that is not among them, or has no such value.
    """

    parameters: Any  # a StiffnessInputs, or the Coordinates of all inputs
    name: ClassVar[str]
    architecture: ClassVar[Architecture]
    learns_from_sensitivities: ClassVar[bool] = False
    defaults: ClassVar[dict] = {"input_transform": "log"}
    """Settings and their default values, for an emulator without a section in the configuration."""

    @classmethod
    def all_defaults(cls) -> dict:
        """`defaults`, with those of the base classes."""
        found: dict = {}
        for base in reversed(cls.__mro__):
            found |= vars(base).get("defaults", {})
        return found

    def __init__(self, **settings):
        self.settings = settings_of(self.name, settings, self.all_defaults())
        self.outputs: tuple[str, ...] = ()
        self.info: dict = {}

    @property
    def channels(self) -> Channels:
        """The outputs as channels. Raises InputError for outputs that are none."""
        return Channels.parse(self.outputs)

    @cached_property
    def lower(self) -> torch.Tensor:
        """Lower bounds (P,) of the parameters."""
        return torch.tensor(self.parameters.lower)

    @cached_property
    def upper(self) -> torch.Tensor:
        """Upper bounds (P,) of the parameters."""
        return torch.tensor(self.parameters.upper)

    @property
    def learnt_from(self) -> torch.Tensor:
        """Values (N, P) of the parameters in the simulations that it knows."""
        return self._unstandardise(self.inputs)

    @property
    def jacobian_factor(self) -> float:
        """Factor on the variance of the errors along the columns of the Jacobian, which are what
        inference mistakes for a change of theta (`likelihood.inflate`)."""
        return 1.0

    # --------------------------------------------------------------------------- interface

    def fit(
        self,
        theta: np.ndarray,
        y: np.ndarray,
        sensitivities: np.ndarray | None = None,
        *,
        parameters: StiffnessInputs | Coordinates,
        outputs: Sequence[str],
        seed: int = 0,
    ) -> Self:
        """Learn from `theta` (N, P) and outputs `y` (N, D) in natural units; return self.

        sensitivities: d(outputs)/d(theta) (N, D, P), for emulators that learn from them.
        parameters: what the columns of theta are. outputs: names of the columns of `y`.

        Raises InputError for too few rows, numbers that are not finite, shapes that do not fit,
        an output that does not vary, or sensitivities that are needed and missing.
        """
        theta, y = np.asarray(theta, dtype=float), np.asarray(y, dtype=float)
        with_sensitivities = self.learns_from_sensitivities and sensitivities is not None
        check_training_set(theta, y, parameters, outputs, with_sensitivities)
        self.parameters, self.outputs = parameters, tuple(outputs)
        theta, y = torch.as_tensor(theta), torch.as_tensor(y)
        self.output_mean, self.output_sd = y.mean(0), y.std(0)
        transformed = self._scaled(theta)
        self.input_mean, self.input_sd = transformed.mean(0), transformed.std(0)
        still = self.input_sd == 0
        if still.any():
            ends = self._scaled(torch.stack([self.lower, self.upper]))
            self.input_sd = torch.where(still, (ends[1] - ends[0]) / 12**0.5, self.input_sd)
        self.inputs = self.standardise(theta)
        gaps = torch.cdist(self.inputs, self.inputs).fill_diagonal_(torch.inf).amin(1)
        self.reach = torch.quantile(gaps, OUTSIDE_QUANTILE)
        slopes = None
        if self.learns_from_sensitivities:
            slopes = _check_sensitivities(self.name, sensitivities, (*y.shape, theta.shape[1]))
            slopes = self._standardise_slopes(slopes, theta)
        training = TrainingSet(self.inputs, (y - self.output_mean) / self.output_sd, slopes)
        self._fit(training, seed)
        return self

    def localise(self, y: torch.Tensor) -> "Emulator":
        """The emulator to use for the observation `y` (D,), natural units.

        A global emulator is the same for all; a local one trains on the simulations whose outputs
        are nearest to `y`, and can predict only then.
        """
        return self

    @property
    def sparse(self) -> "Emulator":
        """A cheaper, sparse approximation, for what this emulator corrects afterwards; itself where
        there is none."""
        return self

    def outside(self, theta: torch.Tensor) -> torch.Tensor:
        """Whether each row of `theta` (..., P) lies where no simulation is near, bool (...).

        On the emulator's own scale of the inputs: outside the box of the training inputs, or
        farther from the nearest of them than 99 % of them are from theirs. Predictions there are
        extrapolations; their variance need not say so.
        """
        x = self.standardise(theta)
        low, high = self.inputs.amin(0), self.inputs.amax(0)
        beyond = ((x < low) | (x > high)).any(-1)
        flat = x.reshape(-1, x.shape[-1])
        return beyond | (torch.cdist(flat, self.inputs).amin(1) > self.reach).reshape(beyond.shape)

    def predict(self, theta: torch.Tensor) -> Prediction:
        """Predict at `theta` (..., P), float64; differentiable."""
        return self._predict(theta)

    def predict_mean(self, theta: torch.Tensor) -> torch.Tensor:
        """Predictive mean (..., D) alone, differentiable; cheaper where an emulator says how."""
        return self.predict(theta).mean

    def with_variance(self, theta: torch.Tensor, variance: torch.Tensor) -> Prediction:
        """Predict at `theta` (..., P) with a `variance` (...) that is given, if the covariance is
        separable; cheaper for an emulator whose mean costs less than its variance."""
        own = self.predict(theta)
        return SeparablePrediction(own.mean, variance, own.output_covariance, own.freedom)

    def jacobian(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor | None]:
        """d(mean)/d(theta) (..., D, P); d(variance)/d(theta) (..., P) if separable, else None.

        One backward pass per output; emulators that know their derivatives override this.
        """
        with torch.enable_grad():
            theta = theta.detach().requires_grad_(True)
            prediction = self.predict(theta)
            rows = [
                torch.autograd.grad(prediction.mean[..., i].sum(), theta, retain_graph=True)[0]
                for i in range(len(self.outputs))
            ]
            slope = None
            if isinstance(prediction, SeparablePrediction):
                slope = torch.autograd.grad(prediction.variance.sum(), theta)[0]
        return torch.stack(rows, dim=-2), slope

    def linearise(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (..., D) and d(mean)/d(theta) (..., D, P) alone, without a graph.

        For thousands of fits at once; emulators whose variance costs more override this.
        """
        with torch.no_grad():
            return self.predict_mean(theta), self.jacobian(theta)[0]

    def select(self, outputs: Sequence[str]) -> Self:
        """This emulator for some of its outputs, in the order given.

        Raises InputError for an output that it does not have.
        """
        missing = [name for name in outputs if name not in self.outputs]
        if missing:
            raise InputError(
                f"{self.name}: no output {', '.join(missing)}; it was fitted to "
                f"{len(self.outputs)} outputs, choose among them or fit it again"
            )
        chosen = copy.copy(self)
        index = torch.tensor([self.outputs.index(name) for name in outputs])
        chosen.outputs = tuple(outputs)
        chosen.output_mean, chosen.output_sd = self.output_mean[index], self.output_sd[index]
        chosen._select(index)
        return chosen

    def save(self, path: str | Path) -> None:
        """Write everything that `load` needs."""
        torch.save(self.content(), path)

    def content(self) -> dict:
        """Everything that `from_content` needs, in tensors and plain values."""
        common = {key: getattr(self, key) for key in ("outputs", "settings", "info", *_TENSORS)}
        return {
            "format": FORMAT,
            "emulator": self.name,
            "parameters": self.parameters.spec(),
            "common": common,
            "state": self._state(),
        }

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote. Raises InputError if another emulator, or another version of the
        project, wrote it."""
        return cls.from_content(torch.load(path, weights_only=True), path)

    @classmethod
    def from_content(cls, content: dict, path: str | Path) -> Self:
        """The emulator of whose `content` this is; `path` is named in the error, as by `load`."""
        if content.get("format") != FORMAT:
            raise InputError(
                f"{path}: another version of this project wrote this emulator; delete the file and "
                "train it again"
            )
        if content["emulator"] != cls.name:
            raise InputError(
                f"{path}: holds the emulator {content['emulator']}, not {cls.name}; load it with "
                "emulators.load"
            )
        emulator = cls(**content["common"]["settings"])
        emulator.parameters = from_spec(content["parameters"])
        for key, value in content["common"].items():
            setattr(emulator, key, value)
        emulator._restore(content["state"])
        return emulator

    # ---------------------------------------------------------------- what a subclass provides

    @abstractmethod
    def _fit(self, training: TrainingSet, seed: int) -> None:
        """Learn; `inputs` (the standardised inputs) are kept already."""

    @abstractmethod
    def _predict(self, theta: torch.Tensor) -> Prediction:
        """Predict in natural units."""

    @abstractmethod
    def _select(self, index: torch.Tensor) -> None:
        """Keep the outputs `index` of this (already copied) emulator."""

    @abstractmethod
    def _state(self) -> dict:
        """Tensors and plain values that `_restore` needs."""

    @abstractmethod
    def _restore(self, state: dict) -> None: ...

    # ---------------------------------------------------------------------------- helpers

    @property
    def _log(self) -> bool:
        return self.settings["input_transform"] == "log"

    @property
    def coordinates(self) -> Coordinates:
        """The scaled coordinates of theta."""
        return self.parameters.coordinates

    def _scaled(self, theta: torch.Tensor) -> torch.Tensor:
        return self.coordinates.scaled(theta) if self._log else theta

    def standardise(self, theta: torch.Tensor) -> torch.Tensor:
        """Inputs on the scale on which the emulator works: mean 0, sd 1 over the training set."""
        return (self._scaled(theta) - self.input_mean) / self.input_sd

    def _unstandardise(self, x: torch.Tensor) -> torch.Tensor:
        transformed = self.input_mean + self.input_sd * x
        return self.coordinates.natural(transformed) if self._log else transformed

    def _standardise_slopes(self, slopes: torch.Tensor, theta: torch.Tensor) -> torch.Tensor:
        """Derivatives (N, D, P) of standardised outputs with respect to standardised inputs, from
        natural ones."""
        return slopes / self.output_sd[:, None] / self.standardise_slope(theta)[:, None, :]

    def _checked(self, theta, y, sensitivities) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Further simulations for a trained emulator as tensors (N, P), (N, D) and (N, D, P);
        InputError if they are anything else."""
        theta, y = np.asarray(theta, dtype=float), np.asarray(y, dtype=float)
        _check_rows(theta, y, len(self.parameters), len(self.outputs))
        slopes = _check_sensitivities(self.name, sensitivities, (*y.shape, theta.shape[1]))
        return torch.as_tensor(theta), torch.as_tensor(y), slopes

    def standardise_slope(self, theta: torch.Tensor) -> torch.Tensor:
        """d(standardised input)/d(theta), (..., P): the transform acts on each parameter alone."""
        slope = 1 / self.input_sd
        return slope / self.coordinates.slope(theta) if self._log else slope.expand_as(theta)


_TENSORS = ("inputs", "reach", "input_mean", "input_sd", "output_mean", "output_sd")


def _check_sensitivities(name: str, sensitivities, shape: tuple[int, ...]) -> torch.Tensor:
    """Sensitivities as a tensor of `shape` (N, D, P); InputError if they are anything else."""
    if sensitivities is None:
        raise InputError(
            f"{name}: learns from sensitivities, and there are none; give simulations with the "
            "column `sensitivity`, or choose another emulator"
        )
    sensitivities = np.asarray(sensitivities, dtype=float)
    if sensitivities.shape != shape:
        raise InputError(
            f"training set: sensitivities have the shape {sensitivities.shape}; expected {shape}, "
            "d(outputs)/d(theta) of every simulation"
        )
    bad = np.flatnonzero(~np.isfinite(sensitivities).all(axis=(1, 2)))
    if bad.size:
        raise InputError(
            f"training set: sensitivities of row {bad[0]} (of {bad.size} such rows) hold numbers "
            "that are not finite; remove these simulations"
        )
    return torch.as_tensor(sensitivities)


def _check_rows(theta: np.ndarray, y: np.ndarray, inputs: int, outputs: int) -> None:
    """Raise InputError for shapes that do not fit and numbers that are not finite."""
    if theta.ndim != 2 or theta.shape[1] != inputs or y.shape != (len(theta), outputs):
        raise InputError(
            f"training set: theta {theta.shape} and outputs {y.shape} do not fit; expected "
            f"(N, {inputs}) and (N, {outputs})"
        )
    bad = np.flatnonzero(~(np.isfinite(theta).all(axis=1) & np.isfinite(y).all(axis=1)))
    if bad.size:
        raise InputError(
            f"training set: row {bad[0]} (of {bad.size} such rows) holds numbers that are not "
            "finite; remove failed simulations first (the screening does it)"
        )


def check_training_set(
    theta: np.ndarray,
    y: np.ndarray,
    parameters: StiffnessInputs | Coordinates,
    outputs: Sequence[str],
    with_sensitivities: bool = False,
) -> None:
    """Raise InputError for what no emulator can learn from; arguments as for `Emulator.fit`.

    with_sensitivities: whether there are any, which tell of what does not vary, too.
    """
    inputs = len(parameters)
    _check_rows(theta, y, inputs, len(outputs))
    needed = least_simulations(inputs, with_sensitivities)
    if len(theta) < needed:
        raise InputError(
            f"training set: {len(theta)} simulations are too few for an emulator of {inputs} "
            f"parameters; simulate at least {needed} (design.natural, design.log)"
        )
    positive = [k for k, low in enumerate(parameters.lower) if low > 0]
    if theta[:, positive].min(initial=1.0) <= 0:
        raise InputError("training set: a factor is not above zero; correct the design")
    twins = repeated(theta)
    if twins is not None:
        raise InputError(
            f"training set: rows {twins[0]} and {twins[1]} have the same theta; keep each "
            "simulation once"
        )
    fixed = [
        name for name, column in zip(parameters.names, theta.T, strict=True) if np.ptp(column) == 0
    ]
    if fixed and not with_sensitivities:
        raise InputError(
            f"training set: {', '.join(fixed)} has one and the same value in every simulation; "
            "leave the factor out (parameters.factors), give its segments to another zone "
            "(parameters.zones), or simulate other values of it"
        )
    still = [name for name, column in zip(outputs, y.T, strict=True) if np.ptp(column) == 0]
    if still:
        raise InputError(
            f"training set: {', '.join(still)} has one and the same value in every simulation; "
            "leave the output out or check the simulator"
        )
