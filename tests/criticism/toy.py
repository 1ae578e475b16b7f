"""A heart in closed form: 52 smooth functions of ten factors, and causes with known signatures."""

import json
import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch

from regional_lv.channels import Channels
from regional_lv.criticism.designs import slope_of
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.hypotheses.end_diastolic_pressure import EndDiastolicPressure
from regional_lv.emulators.base import Emulator, Prediction, SeparablePrediction
from regional_lv.inputs.scales import Linear, Scale
from regional_lv.measured import synthetic_subject
from regional_lv.parameters import Parameterisation

PARAMETERS = Parameterisation()
CHANNELS = Channels.of()
OUTPUTS = CHANNELS.names
D = len(OUTPUTS)
DIRECTIONS = ("circumferential", "radial", "longitudinal")


class ToyEmulator(Emulator):
    """mean = centre + W log theta + bend W2 (log theta)^2; errors of a tenth of a milli-strain."""

    name = "toy"

    def __init__(self, bend: float = 1.0):
        self.settings, self.info, self.bend = {}, {}, bend
        self.outputs, self.parameters = OUTPUTS, PARAMETERS
        rng = np.random.default_rng(0)
        zone = PARAMETERS.segment_zone
        w = np.zeros((D, 10))
        w[0] = -8.0
        size = {"circumferential": 0.04, "radial": -0.08, "longitudinal": 0.03}
        for k, direction in enumerate(DIRECTIONS):
            for i in range(17):
                row = 1 + 17 * k + i
                own = size[direction] * (1 + 0.3 * rng.standard_normal(2))
                w[row, 2 * zone[i] : 2 * zone[i] + 2] = own
                w[row] += 0.1 * size[direction] * rng.standard_normal(10)
        self.w = torch.as_tensor(w)
        self.w2 = 0.2 * self.w * torch.as_tensor(rng.uniform(-1, 1, (D, 10)))
        centre = np.r_[150.0, np.repeat([-0.12, 0.4, -0.14], 17)]
        self.centre = torch.as_tensor(centre)
        sd = torch.as_tensor(np.r_[20.0, np.repeat([0.05, 0.1, 0.04], 17)])
        self.output_sd, self.output_mean = sd, self.centre
        self.output_covariance = torch.diag((sd * 1e-3).square())

    def _predict(self, theta):
        x = theta.log()
        mean = self.centre + x @ self.w.T + self.bend * (x * x) @ self.w2.T
        one = torch.ones(theta.shape[:-1], dtype=theta.dtype)
        return SeparablePrediction(mean, one, self.output_covariance)

    def linearise(self, theta):
        slopes = self.w + 2 * self.bend * self.w2 * theta.log()[..., None, :]
        return self.predict_mean(theta), slopes / theta[..., None, :]

    def outside(self, theta):
        return torch.zeros(theta.shape[:-1], dtype=torch.bool)

    def _select(self, index):
        for key in ("w", "w2", "centre"):
            setattr(self, key, getattr(self, key)[index])
        self.output_covariance = self.output_covariance[index][:, index]

    def _fit(self, training, seed): ...
    def _state(self): ...
    def _restore(self, state): ...


LINEAR = Linear()


@dataclass(frozen=True)
class Hypothesis:
    name: str
    base: float
    low: float
    high: float
    unit: str = "1"
    parameter: str = "size"
    description: str = "A change of the outputs."
    source: str = "made up"
    load_power: float = 0.0
    signature_at: float | None = None
    scale: Scale = LINEAR
    order: int = 0

    def at_load(self, psi, fraction):
        return psi * fraction**self.load_power


class Extension:
    """delta = amount(psi) * pattern (D,) * (1 + theta dependence)."""

    fraction_simulated = 1.0

    def __init__(self, hypothesis, pattern, component="", outputs=OUTPUTS):
        self.hypothesis, self.component, self.outputs = hypothesis, component, outputs
        self.pattern = pattern

    def mean(self, outputs, theta, psi):
        at = torch.tensor([OUTPUTS.index(o) for o in self.outputs])
        tilt = 1 + 0.1 * theta.log().mean(-1, keepdim=True)
        return (psi - self.hypothesis.base)[..., None] * tilt * self.pattern[at]

    def difference(self, outputs, theta, psi):
        mean = self.mean(outputs, theta, psi)
        return Prediction(mean, torch.zeros(*mean.shape, mean.shape[-1], dtype=mean.dtype))

    def select(self, outputs):
        return Extension(self.hypothesis, self.pattern, self.component, tuple(outputs))


class Pressure(Extension):
    """All C_a together by 8 / psi: what theta takes up."""

    def __init__(self, outputs=OUTPUTS):
        super().__init__(EndDiastolicPressure(), torch.zeros(D).double(), "", outputs)

    def select(self, outputs):
        return Pressure(tuple(outputs))


TAILS = Hypothesis("heavy_tails", 0.0, 0.0, 0.4)


def pattern(direction: str, segments, size: float) -> torch.Tensor:
    wanted = {f"{direction}_{s:02d}" for s in segments}
    return size * torch.tensor([name in wanted for name in OUTPUTS], dtype=torch.float64)


def bias() -> Extension:
    """Radial strains too large by psi: theta takes up only part of it."""
    both = pattern("radial", range(1, 18), 0.1)
    return Extension(Hypothesis("radial_scale", 0.0, -2.0, 2.0), both)


def basal() -> Extension:
    """A base that moves: one way only."""
    wave = pattern("circumferential", range(1, 7), -0.05) + pattern("radial", range(1, 7), 0.08)
    return Extension(Hypothesis("basal_motion", 0.0, 0.0, 2.0, "mm/kPa"), wave)


def scars() -> list[Extension]:
    """One segment stiffer than its zone."""
    found = []
    for s in range(1, 18):
        shape = pattern("circumferential", [s], 0.05) + pattern("radial", [s], -0.1)
        found.append(Extension(Hypothesis("focal_scar", 0.0, -1.0, 2.0), shape, component=str(s)))
    return found


def catalogue() -> list[Extension]:
    return [Pressure(), bias(), basal(), *scars()]


THETA = torch.tensor([1.0, 1.2, 1.1, 0.9, 1.8, 1.5, 0.9, 1.1, 1.0, 0.8], dtype=torch.float64)


def measured(emulator, extension=None, psi=0.0, seed=0, strain=0.01, theta=THETA, known=True):
    """Measured table of the toy emulator with an effect."""
    with torch.no_grad():
        outputs = emulator.predict(theta).mean
        if extension is not None:
            value = torch.tensor(psi, dtype=torch.float64)
            at = extension.hypothesis.scale(value)[None]
            outputs = ExtendedEmulator(emulator, [extension]).mean(theta, at)
    unit = np.random.default_rng(seed).standard_normal(len(outputs))
    noise = {"strain": strain, "volume": 100 * strain}
    table = synthetic_subject(outputs.numpy(), CHANNELS, noise, unit)
    return table if known else table.assign(sd=math.nan)


class Bent(Extension):
    """An effect that begins at the apex and ends with the pattern."""

    def mean(self, outputs, theta, psi):
        d = psi - self.hypothesis.base
        at = torch.tensor([OUTPUTS.index(o) for o in self.outputs])
        first = pattern("radial", [14, 17], 0.02)[at]
        later = Extension.mean(self, outputs, theta, self.hypothesis.base + d * d)
        return d[..., None] * first + later

    def select(self, outputs):
        return Bent(self.hypothesis, self.pattern, self.component, tuple(outputs))


def simulate(extensions, interaction: float = 0.0):
    """Simulates designs of a confirmation in closed form; effects of several causes at once differ
    from their sum by a wave of size `interaction`."""
    by_place = {(e.hypothesis.name, e.component): e for e in extensions}
    emulator, wave = ToyEmulator(), interaction * torch.sin(torch.arange(D, dtype=torch.float64))

    def made(design: pd.DataFrame) -> pd.DataFrame:
        rows = []
        for _, row in design.iterrows():
            theta = torch.tensor([row[name] for name in PARAMETERS.names], dtype=torch.float64)
            effects = json.loads(row["effects"])
            present = [by_place[name, component] for name, (_, component) in effects.items()]
            scaled = [
                extension.hypothesis.scale(value)
                for extension, (value, _) in zip(present, effects.values(), strict=True)
            ]
            both = ExtendedEmulator(emulator, present)
            total, slopes, _ = both.linearise(theta, torch.tensor(scaled, dtype=torch.float64))
            total = total + (wave if len(effects) > 1 else 0.0)
            made = dict(zip(OUTPUTS, total.tolist(), strict=True))
            made |= {slope_of(o): s for o, s in zip(OUTPUTS, slopes.tolist(), strict=True)}
            rows.append(made)
        return pd.concat([design.reset_index(drop=True), pd.DataFrame(rows)], axis=1)

    return made
