"""The base emulator with extensions on top: one simulator with a few more parameters."""

from collections.abc import Sequence

import torch

from regional_lv.criticism.hypotheses.base import LoadHypothesis, pressure_scaled
from regional_lv.emulators.base import Emulator, Prediction
from regional_lv.errors import InputError

STEP = 1e-4
"""Finite-difference step, in log theta and in shares of psi's range: emulated differences are
smooth and computed in double precision."""

OUTPUT_STEP = 1e-6
"""The same, relative, in outputs, of which the differences are functions in closed form."""


class ExtendedEmulator:
    """f(theta) with the effects of its extensions, one on top of the other.

    What happens in the ventricle, and where it is looked at, adds up on the scale of `differences`:
    logarithms of the volume and of the stretches. Then come another measure of the strains and what
    is reported of them (`Hypothesis.order`), each of what is there by then. Another load acts on
    all of it: stresses scale, so that the ventricle is asked for at another theta, and with springs
    as many times stiffer.

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
        for extension in self.extensions:
            if extension.outputs != emulator.outputs:
                raise InputError(
                    f"{extension.hypothesis.name}: the base emulator has other outputs than the "
                    "extension; select the same of both"
                )
        hypotheses = [e.hypothesis for e in self.extensions]
        self._loads = [i for i, h in enumerate(hypotheses) if isinstance(h, LoadHypothesis)]
        others = [i for i in range(len(hypotheses)) if i not in self._loads]
        self._others = sorted(others, key=lambda i: hypotheses[i].order)
        self._known: tuple[torch.Tensor, torch.Tensor] | None = None

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.emulator.outputs

    def with_extensions(self, *extensions) -> "ExtendedEmulator":
        """The same with more extensions; a correction does not outlive that."""
        return ExtendedEmulator(self.emulator, (*self.extensions, *extensions))

    # ------------------------------------------------------------------------------ prediction

    def predict(self, theta: torch.Tensor, scaled: torch.Tensor) -> Prediction:
        """Mean (..., D) and covariance (..., D, D), of all parts, at `theta` (..., P); the
        covariance as under the study's load."""
        base = self.emulator.predict(theta)
        total, covariance = base.mean, base.covariance
        for i in self._others:
            extension, psi = self.extensions[i], self._psi(i, scaled)
            part = extension.difference(total, theta, psi)
            gain = self._gain(extension, total, part.mean, theta, psi)
            covariance = gain[..., :, None] * covariance * gain[..., None, :]
            if self.correction is None:
                covariance = covariance + part.covariance
            total = total + part.mean
        if self.correction is not None:
            covariance = covariance + self.correction.covariance
        return Prediction(self.mean(theta, scaled), covariance)

    @torch.no_grad()
    def mean(self, theta: torch.Tensor, scaled: torch.Tensor) -> torch.Tensor:
        """Mean (..., D). An extension costs nothing where its psi has the base value."""
        total = self._mean(theta, scaled, self._loads)
        if self.correction is not None:
            total = total + self.correction.mean(theta, scaled)
        return total

    def _mean(self, theta, scaled, loads: list[int]) -> torch.Tensor:
        if not loads:
            return self._under_full_load(theta, scaled)
        i, rest = loads[-1], loads[:-1]
        at = self._acts(i, scaled)
        if not at.any():
            return self._mean(theta, scaled, rest)
        moved, others = theta.clone(), scaled.clone()
        share = self.extensions[i].hypothesis.share(self._psi(i, scaled[at]))
        moved[at], others[at] = self.under_load(theta[at], scaled[at], share)
        concerned = self._concerned(i)
        if concerned.all():
            return self._mean(moved, others, rest)
        total = self._mean(theta, scaled, rest).clone()
        total[at] = torch.where(concerned, self._mean(moved[at], others[at], rest), total[at])
        return total

    def _under_full_load(self, theta, scaled) -> torch.Tensor:
        total = self._base(theta).clone()
        for i in self._others:
            at = self._acts(i, scaled)
            if at.any():
                psi = self._psi(i, scaled[at])
                total[at] = total[at] + self.extensions[i].mean(total[at], theta[at], psi)
        return total

    def _base(self, theta: torch.Tensor) -> torch.Tensor:
        """The base model's mean. The last one is kept: scores of many causes are asked for at the
        same theta."""
        if self._known is None or not torch.equal(self._known[0], theta):
            self._known = theta.clone(), self.emulator.predict_mean(theta)
        return self._known[1]

    # ----------------------------------------------------------------------------- derivatives

    @torch.no_grad()
    def linearise(
        self, theta: torch.Tensor, scaled: torch.Tensor, active: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Mean (..., D), its derivatives about log theta (..., D, P) and about `scaled` (..., D,
        k).

        active: (..., k), which extensions are free; the others have the base value, and a
        derivative of zero. All if None.
        """
        if active is None:
            active = torch.ones_like(scaled, dtype=torch.bool)
        mean, slopes, by_scaled = self._linearise(theta, scaled, active, self._loads)
        if self.correction is not None:
            mean = mean + self.correction.mean(theta, scaled)
            slopes = slopes + self.correction.by_log_theta
            by_scaled = by_scaled + self.correction.by_scaled
        return mean, slopes, by_scaled

    def _linearise(self, theta, scaled, active, loads: list[int]):
        if not loads:
            return self._linearise_full_load(theta, scaled, active)
        i, rest = loads[-1], loads[:-1]
        at = active[..., i]
        if not at.any():
            return self._linearise(theta, scaled, active, rest)
        found = self._linearise(theta, scaled, active, rest)
        moved = self._linearise_share(theta[at], scaled[at], active[at], i, rest)
        concerned = self._concerned(i)
        for whole, part in zip(found, moved, strict=True):
            mask = concerned if whole is found[0] else concerned[:, None]
            whole[at] = torch.where(mask, part, whole[at])
        return found

    def _linearise_share(self, theta, scaled, active, i: int, rest: list[int]):
        """As `_linearise`, of all channels under the load that the extension `i` says."""
        share = self.extensions[i].hypothesis.share

        def at(others, own):
            return self.under_load(theta, others, share(self._psi(i, own)))

        moved, others = at(scaled, scaled)
        mean, slopes, by_others = self._linearise(moved, others, active, rest)
        # Of every psi about itself, and of theta and every psi about the load.
        step = torch.stack([self._step(j, scaled[..., j]) for j in range(scaled.shape[-1])], -1)
        own = (at(scaled + step, scaled)[1] - others) / step
        by_scaled = by_others * own[..., None, :]
        there, springs = at(scaled, scaled + step)
        by_load = (slopes @ (there.log() - moved.log())[..., None])[..., 0]
        by_load = by_load + (by_others @ (springs - others)[..., None])[..., 0]
        by_scaled[..., i] = by_load / step[..., None, i]
        return mean, slopes, by_scaled

    def _linearise_full_load(self, theta, scaled, active):
        total, slopes = self.emulator.linearise(theta)
        total, slopes = total.clone(), slopes * theta[..., None, :]
        by_scaled = torch.zeros(*total.shape, scaled.shape[-1], dtype=total.dtype)
        count = theta.shape[-1]
        for i in self._others:
            at = active[..., i]
            if not at.any():
                continue
            extension, own, value, outputs = self.extensions[i], theta[at], scaled[at], total[at]
            step = self._step(i, value[..., i])
            # Here, at another psi, at every other theta; outputs as they are.
            moved = own[..., None, :] * torch.exp(STEP * torch.eye(count, dtype=theta.dtype))
            points = torch.cat([own[..., None, :], own[..., None, :], moved], dim=-2)
            values = value[..., None, i].expand(*step.shape, count + 2).clone()
            values[..., 1] += step
            psi = extension.hypothesis.scale.inverse(values)
            there = outputs[..., None, :].expand(*points.shape[:-1], -1)
            found = extension.mean(there, points, psi)
            here = found[..., 0, :]
            gain = self._gain(extension, outputs, here, own, psi[..., 0])[..., None]
            slopes[at] = gain * slopes[at] + (found[..., 2:, :] - here[..., None, :]).mT / STEP
            by_scaled[at] = gain * by_scaled[at]
            by_scaled[..., i][at] = (found[..., 1, :] - here) / step[..., None]
            total[at] = outputs + here
        return total, slopes, by_scaled

    @torch.no_grad()
    def signature(self, extension, theta: torch.Tensor, scaled: torch.Tensor) -> torch.Tensor:
        """d(outputs)/d(scaled psi) (..., D) of one of the extensions, or of one more, at its base
        value, or up to where its hypothesis says (`signature_at`); the others at `scaled`."""
        h, both = extension.hypothesis, self
        base, low, high = (h.scale(value) for value in (h.base, h.low, h.high))
        if extension not in self.extensions:
            both = self.with_extensions(extension)
            both._known = self._known
            scaled = torch.cat([scaled, scaled.new_full((*scaled.shape[:-1], 1), base)], dim=-1)
        step = STEP * (high - low)
        ahead, behind = min(base + step, high), max(base - step, low)
        if h.signature_at is not None:
            ahead, behind = h.scale(h.signature_at), base
        at, sides = both.extensions.index(extension), []
        for end in (ahead, behind):
            there = scaled.clone()
            there[..., at] = end
            sides.append(both.mean(theta, there))
        self._known = both._known
        return (sides[0] - sides[1]) / (ahead - behind)

    def under_load(self, theta: torch.Tensor, scaled: torch.Tensor, share: torch.Tensor):
        """Theta (..., P) and psi (..., k) at which the study's load does what its `share` (...)
        does at these; springs as stiff as their range allows."""
        moved = scaled.clone()
        for i in self._others:
            h, psi = self.extensions[i].hypothesis, self._psi(i, scaled)
            there = h.at_load(psi, share)
            if there is not psi:
                moved[..., i] = h.scale(there.clamp(h.low, h.high))
        return pressure_scaled(self.emulator.parameters, theta, share), moved

    # --------------------------------------------------------------------------------- helpers

    def _psi(self, i: int, scaled: torch.Tensor) -> torch.Tensor:
        return self.extensions[i].hypothesis.scale.inverse(scaled[..., i])

    def _acts(self, i: int, scaled: torch.Tensor) -> torch.Tensor:
        """Where (...) psi has another than the base value."""
        h = self.extensions[i].hypothesis
        return scaled[..., i] != h.scale(h.base)

    def _concerned(self, i: int) -> torch.Tensor:
        """Mask (D,) of the channels under the load of an extension."""
        return torch.as_tensor(self.extensions[i].hypothesis.concerned(self.outputs))

    def _step(self, i: int, value: torch.Tensor) -> torch.Tensor:
        """A step (...) of psi on its scale from `value` (...), inside the range."""
        h = self.extensions[i].hypothesis
        low, high = h.scale(h.low), h.scale(h.high)
        step = STEP * (high - low)
        return torch.where(value + step > high, -step, step).to(value.dtype)

    @staticmethod
    def _gain(extension, outputs, here, theta, psi) -> torch.Tensor:
        """Derivative (..., D) of outputs with an effect about those without it, channel by channel;
        here: what it adds to them."""
        step = OUTPUT_STEP * (1 + outputs.abs())
        return 1 + (extension.mean(outputs + step, theta, psi) - here) / step
