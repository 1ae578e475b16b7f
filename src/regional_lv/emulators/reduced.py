"""What emulators of the reduced outputs share: the paper's outputs are scores, not strains."""

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
import torch

from regional_lv.emulators.base import Emulator, Prediction, TrainingSet, row_jacobian
from regional_lv.emulators.reduction import Reduction
from regional_lv.emulators.shared_kernel import choose_kernel
from regional_lv.seeds import derive

LEAST_VARIANCE = 1e-10
"""Of every output, in squared training sd: outputs may depend on one another exactly."""


class ReducedEmulator(Emulator):
    """An emulator of K scores, of unit variance and uncorrelated over the training set.

    The scores are principal components of the standardised outputs but the volumes, and these
    (`reduction.Reduction`); predictions are mapped back, and the variance of the components left
    out (setting `explained_variance`) is added to their covariance.

    A subclass implements `_fit_scores`, `_mean`, `_covariance`; `_KEYS` names the attributes that
    make up its state, tensors and plain values. One with a torch module keeps it as `model`, whose
    state is saved too, and implements `_build`.
    """

    defaults: ClassVar[dict] = {"explained_variance": 0.999, "kernel": "auto"}
    _KEYS: tuple[str, ...] = ()
    model: Any = None

    @abstractmethod
    def _fit_scores(self, x: torch.Tensor, z: torch.Tensor, seed: int) -> None:
        """Learn from standardised inputs (N, P) and scores (N, K)."""

    @abstractmethod
    def _mean(self, x: torch.Tensor) -> torch.Tensor:
        """Mean scores (M, K) at standardised inputs (M, P), row by row."""

    @abstractmethod
    def _covariance(self, x: torch.Tensor) -> torch.Tensor:
        """Variances (M, K) of independent scores, or their covariances (M, K, K)."""

    # ------------------------------------------------------------------------------- fitting

    def _fit(self, training: TrainingSet, seed: int) -> None:
        reduction = Reduction.fit(
            training.y.numpy(), self.settings["explained_variance"], self.channels
        )
        scores = reduction.transform(training.y.numpy())
        self.score_sd = torch.as_tensor(scores.std(axis=0, ddof=1))
        self.to_outputs = torch.as_tensor(reduction.inverse_matrix()) * self.score_sd
        left_out = torch.as_tensor(reduction.truncation_covariance())
        self.left_out = left_out + LEAST_VARIANCE * torch.eye(len(left_out), dtype=left_out.dtype)
        self.info = {"scores": scores.shape[1]}
        z = torch.as_tensor(scores) / self.score_sd
        self._fit_scores(training.x, z, seed)
        if self.model is not None:
            self.model.eval().requires_grad_(False)

    def _choose_kernel(self, x, z, nugget: float, seed: int) -> str:
        """The kernel of the setting `kernel`; `auto` is cross-validation."""
        kernel = self.settings["kernel"]
        if kernel == "auto":
            kernel, errors = choose_kernel(x, z, nugget, derive(seed, "kernel"))
            self.info["kernel_errors"] = errors
        self.info["kernel"] = kernel
        return kernel

    # ---------------------------------------------------------------------------- predicting

    def _predict(self, theta: torch.Tensor) -> Prediction:
        shape = theta.shape[:-1]
        x = self.standardise(theta.reshape(-1, theta.shape[-1]))
        to_outputs = self.output_sd[:, None] * self.to_outputs
        covariance = self._covariance(x)
        if covariance.ndim == 2:
            spread = (to_outputs * covariance[:, None, :]) @ to_outputs.T
        else:
            spread = to_outputs @ covariance @ to_outputs.T
        spread = spread + self.output_sd[:, None] * self.left_out * self.output_sd
        return Prediction(self.predict_mean(theta), spread.reshape(*shape, *spread.shape[1:]))

    def predict_mean(self, theta: torch.Tensor) -> torch.Tensor:
        """As in the base class, without the covariance."""
        x = self.standardise(theta.reshape(-1, theta.shape[-1]))
        scores = self._mean(x) @ (self.output_sd[:, None] * self.to_outputs).T
        return (self.output_mean + scores).reshape(*theta.shape[:-1], -1)

    def jacobian(self, theta: torch.Tensor) -> tuple[torch.Tensor, None]:
        """As in the base class, from the derivative of the mean scores."""
        shape = theta.shape[:-1]
        flat = theta.detach().reshape(-1, theta.shape[-1])
        with torch.no_grad():
            by_x = self._mean_jacobian(self.standardise(flat))
        by_theta = self.output_sd[:, None] * (self.to_outputs @ by_x)
        by_theta = by_theta * self.standardise_slope(flat)[:, None, :]
        return by_theta.reshape(*shape, *by_theta.shape[1:]), None

    def _mean_jacobian(self, x: torch.Tensor) -> torch.Tensor:
        """d(mean scores)/dx (M, K, P); emulators that know their derivatives override this."""
        return row_jacobian(self._mean, x)

    # --------------------------------------------------------------------------- keeping

    def _select(self, index: torch.Tensor) -> None:
        self.to_outputs = self.to_outputs[index]
        self.left_out = self.left_out[index][:, index]

    def _build(self, weights: dict[str, torch.Tensor]) -> torch.nn.Module:
        """A module into which its state `weights` can be loaded."""
        raise NotImplementedError

    def _state(self) -> dict:
        state = {key: getattr(self, key) for key in (*_MAP, *self._KEYS)}
        return state | ({} if self.model is None else {"model": self.model.state_dict()})

    def _restore(self, state: dict) -> None:
        state = dict(state)
        weights = state.pop("model", None)
        for key, value in state.items():
            setattr(self, key, value)
        if weights is not None:
            self.model = self._build(weights)
            self.model.load_state_dict(weights)
            self.model.eval().requires_grad_(False)


_MAP = ("score_sd", "to_outputs", "left_out")


def held_out(rows: int, share: float, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Row numbers to train on and to hold out, a random `share` of at least one row each."""
    order = np.random.default_rng(derive(seed, "held out")).permutation(rows)
    count = min(max(1, round(share * rows)), rows - 1)
    return torch.as_tensor(order[count:]), torch.as_tensor(order[:count])
