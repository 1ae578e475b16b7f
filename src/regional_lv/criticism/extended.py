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

    def corrected(self, correction) -> "ExtendedEmulator":
        return ExtendedEmulator(self.emulator, self.extensions, correction)

    def predict(self, theta: torch.Tensor, psi: torch.Tensor) -> Prediction:
        """Mean (..., D) and covariance (..., D, D), the sum of all parts, at `theta` (..., P) and
        `psi` (..., k)."""
        base = self.emulator.predict(theta)
        mean, covariance = base.mean, base.covariance
        for i, extension in enumerate(self.extensions):
            part = extension.difference(self.emulator, theta, psi[..., i])
            mean = mean + part.mean
            if self.correction is None:
                covariance = covariance + part.covariance
        if self.correction is not None:
            mean = mean + self.correction.mean(theta, psi)
            covariance = covariance + self.correction.covariance
        return Prediction(mean, covariance)

    @torch.no_grad()
    def mean(self, theta: torch.Tensor, psi: torch.Tensor) -> torch.Tensor:
        """Mean (..., D). An extension costs nothing where its psi has the base value."""
        base = self.emulator.predict_mean(theta)
        total = base.clone()
        for i, extension in enumerate(self.extensions):
            at = psi[..., i] != extension.hypothesis.base
            if at.any():
                known = (theta[at], psi[..., i][at], base[at])
                total[at] = total[at] + extension.mean(self._base, *known)
        if self.correction is not None:
            total = total + self.correction.mean(theta, psi)
        return total

    @torch.no_grad()
    def linearise(
        self, theta: torch.Tensor, psi: torch.Tensor, active: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Mean (..., D), its derivatives about log theta (..., D, P) and about psi (..., D, k).

        active: (..., k), which extensions are free; the others have the base value, and a
        derivative of zero. All if None.
        """
        base, slopes = self.emulator.linearise(theta)
        slopes = slopes * theta[..., None, :]
        mean, by_base, slopes = base.clone(), slopes, slopes.clone()
        by_psi = torch.zeros(*mean.shape, len(self.extensions), dtype=mean.dtype)
        count = theta.shape[-1]
        for i, extension in enumerate(self.extensions):
            at = torch.ones_like(psi[..., i], dtype=torch.bool)
            if active is not None:
                at = active[..., i]
            if not at.any():
                continue
            own, value, known = theta[at], psi[..., i][at], base[at]
            h = extension.hypothesis
            step = STEP * (h.high - h.low)
            step = torch.where(value + step > h.high, -step, step)
            moved = own[..., None, :] * torch.exp(STEP * torch.eye(count, dtype=theta.dtype))
            points = torch.cat([own[..., None, :], own[..., None, :], moved], dim=-2)
            values = value[..., None].expand(*value.shape, count + 2).clone()
            values[..., 1] += step
            # To first order, as all of this is: the base model need not be asked again.
            nearby = known[..., None, :] + STEP * by_base[at].mT
            outputs = torch.cat([known[..., None, :], known[..., None, :], nearby], dim=-2)
            found = extension.mean(self._base, points, values, outputs)
            here = found[..., 0, :]
            mean[at] = mean[at] + here
            by_psi[..., i][at] = (found[..., 1, :] - here) / step[..., None]
            slopes[at] = slopes[at] + (found[..., 2:, :] - here[..., None, :]).mT / STEP
        if self.correction is not None:
            mean = mean + self.correction.mean(theta, psi)
            slopes = slopes + self.correction.by_log_theta
            by_psi = by_psi + self.correction.by_psi
        return mean, slopes, by_psi

    @torch.no_grad()
    def signature(self, extension, theta: torch.Tensor) -> torch.Tensor:
        """d(outputs)/d(psi) (..., D) of one more extension at its base value, or up to where its
        hypothesis says (`signature_at`)."""
        h = extension.hypothesis
        step = STEP * (h.high - h.low)
        ahead, behind = min(h.base + step, h.high), max(h.base - step, h.low)
        if h.signature_at is not None:
            ahead, behind = h.signature_at, h.base
        base = theta.new_full(theta.shape[:-1], h.base)
        outputs = self.emulator.predict_mean(theta)
        difference = extension.mean(self._base, theta, base + (ahead - h.base), outputs)
        if behind < h.base:
            difference = difference - extension.mean(
                self._base, theta, base - (h.base - behind), outputs
            )
        return difference / (ahead - behind)
