"""The base emulator with extensions on top: one simulator with a few more parameters."""

from collections.abc import Sequence

import torch

from regional_lv.emulators.base import Emulator, Prediction

STEP = 1e-4
"""Finite-difference step, in log theta and in shares of psi's range: emulated differences are
smooth and computed in double precision."""


class MeanOnly:
    """An emulator that predicts its mean, with a covariance of zero: differences of closed form ask
    the base emulator many times, and its covariance costs most and is of no use to them."""

    def __init__(self, emulator: Emulator):
        self.emulator = emulator

    def __getattr__(self, name: str):
        return getattr(self.emulator, name)

    def predict(self, theta: torch.Tensor) -> Prediction:
        mean = self.emulator.predict_mean(theta)
        none = torch.zeros((), dtype=mean.dtype).expand(*mean.shape, mean.shape[-1])
        return Prediction(mean, none)


class ExtendedEmulator:
    """f(theta) plus the differences of its extensions, which add up.

    Psi is asked for on the scales of the hypotheses: `scaled` (..., k), one per extension.

    extensions: `criticism.extension.Extension`s for the same outputs as `emulator`. correction: a
    `criticism.confirmation.Correction` from simulations with all their effects at once, if there is
    one; its covariance takes the place of the extensions'. The base emulator's stays: a channel
    without noise, like a volume taken as exact, would otherwise have to be met to what is left of
    the simulations' error, and a set would be judged by another rule than the base model.
    """

    def __init__(self, emulator: Emulator, extensions: Sequence = (), correction=None):
        self.emulator, self.extensions = emulator, tuple(extensions)
        self.correction = correction
        self._base = MeanOnly(emulator)

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.emulator.outputs

    def with_extensions(self, *extensions) -> "ExtendedEmulator":
        """The same with more extensions; a correction does not outlive that."""
        return ExtendedEmulator(self.emulator, (*self.extensions, *extensions))

    def predict(self, theta: torch.Tensor, scaled: torch.Tensor) -> Prediction:
        """Mean (..., D) and covariance (..., D, D), the sum of all parts, at `theta` (..., P)."""
        base = self.emulator.predict(theta)
        mean, covariance = base.mean, base.covariance
        for i, extension in enumerate(self.extensions):
            psi = extension.hypothesis.scale.inverse(scaled[..., i])
            part = extension.difference(self.emulator, theta, psi)
            mean = mean + part.mean
            if self.correction is None:
                covariance = covariance + part.covariance
        if self.correction is not None:
            mean = mean + self.correction.mean(theta, scaled)
            covariance = covariance + self.correction.covariance
        return Prediction(mean, covariance)

    @torch.no_grad()
    def mean(self, theta: torch.Tensor, scaled: torch.Tensor) -> torch.Tensor:
        """Mean (..., D). An extension costs nothing where its psi has the base value."""
        base = self.emulator.predict_mean(theta)
        total = base.clone()
        for i, extension in enumerate(self.extensions):
            h = extension.hypothesis
            at = scaled[..., i] != h.scale(h.base)
            if at.any():
                psi = h.scale.inverse(scaled[..., i][at])
                total[at] = total[at] + extension.mean(self._base, theta[at], psi, base[at])
        if self.correction is not None:
            total = total + self.correction.mean(theta, scaled)
        return total

    @torch.no_grad()
    def linearise(
        self, theta: torch.Tensor, scaled: torch.Tensor, active: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Mean (..., D), its derivatives about log theta (..., D, P) and about `scaled` (..., D,
        k).

        active: (..., k), which extensions are free; the others have the base value, and a
        derivative of zero. All if None.
        """
        base, slopes = self.emulator.linearise(theta)
        slopes = slopes * theta[..., None, :]
        mean, by_base, slopes = base.clone(), slopes, slopes.clone()
        by_scaled = torch.zeros(*mean.shape, len(self.extensions), dtype=mean.dtype)
        count = theta.shape[-1]
        for i, extension in enumerate(self.extensions):
            at = torch.ones_like(scaled[..., i], dtype=torch.bool)
            if active is not None:
                at = active[..., i]
            if not at.any():
                continue
            own, value, known = theta[at], scaled[..., i][at], base[at]
            scale, low, high = _range(extension.hypothesis)
            step = STEP * (high - low)
            step = torch.where(value + step > high, -step, step)
            moved = own[..., None, :] * torch.exp(STEP * torch.eye(count, dtype=theta.dtype))
            points = torch.cat([own[..., None, :], own[..., None, :], moved], dim=-2)
            values = value[..., None].expand(*value.shape, count + 2).clone()
            values[..., 1] += step
            # To first order, as all of this is: the base model need not be asked again.
            nearby = known[..., None, :] + STEP * by_base[at].mT
            outputs = torch.cat([known[..., None, :], known[..., None, :], nearby], dim=-2)
            found = extension.mean(self._base, points, scale.inverse(values), outputs)
            here = found[..., 0, :]
            mean[at] = mean[at] + here
            by_scaled[..., i][at] = (found[..., 1, :] - here) / step[..., None]
            slopes[at] = slopes[at] + (found[..., 2:, :] - here[..., None, :]).mT / STEP
        if self.correction is not None:
            mean = mean + self.correction.mean(theta, scaled)
            slopes = slopes + self.correction.by_log_theta
            by_scaled = by_scaled + self.correction.by_scaled
        return mean, slopes, by_scaled

    @torch.no_grad()
    def signature(self, extension, theta: torch.Tensor) -> torch.Tensor:
        """d(outputs)/d(scaled psi) (..., D) of one more extension at its base value, or up to where
        its hypothesis says (`signature_at`)."""
        h = extension.hypothesis
        scale, low, high = _range(h)
        base, step = scale(h.base), STEP * (high - low)
        ahead, behind = min(base + step, high), max(base - step, low)
        if h.signature_at is not None:
            ahead, behind = scale(h.signature_at), base
        outputs, sides = self.emulator.predict_mean(theta), []
        for end in (ahead, behind):
            psi = theta.new_full(theta.shape[:-1], scale.inverse(end))
            sides.append(0.0 if end == base else extension.mean(self._base, theta, psi, outputs))
        return (sides[0] - sides[1]) / (ahead - behind)


def _range(hypothesis) -> tuple:
    """The scale of psi, and the ends of its range on it."""
    scale = hypothesis.scale
    return scale, scale(hypothesis.low), scale(hypothesis.high)
