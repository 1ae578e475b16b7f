"""Inputs with roles and functions of them whose posteriors are known."""

import numpy as np
import torch

from regional_lv.emulators.base import row_jacobian
from regional_lv.inference.noise import Noise
from regional_lv.inference.potential import Potential
from regional_lv.inputs.base import Input
from regional_lv.inputs.scales import Linear
from regional_lv.inputs.space import Inputs, Role


class Toy(Input):
    """A number in a range; nominal: None for one that is inferred."""

    family = changes = "toy"
    parameter = description = source = "none"

    def __init__(self, name, low, high, nominal=None, scale=None):
        self.name, self.low, self.high, self.nominal = name, low, high, nominal
        self.scale = scale or Linear()


class Emulator:
    """`function` (M, K) -> (M, D), with exact derivatives, and the same errors everywhere."""

    def __init__(self, function, covariance):
        self.function, self.error = function, covariance

    def mean(self, x):
        return self.function(x)

    def linearise(self, x):
        return self.function(x), row_jacobian(self.function, x)

    def predict(self, x):
        return self.mean(x), self.error[None]


def toy_inputs(inferred=0, measured=(), suspected=0, half=1.0, ends=()) -> Inputs:
    """Inferred t0, t1, ... and suspected c0, ... in [-half, half]; measured m0, ... about 0 with
    the sds given and far ends. ends: of single inputs, ((name, low, high), ...)."""
    members, roles = [], {}
    for name, count, role in (("t", inferred, "inferred"), ("c", suspected, "suspected")):
        for i in range(count):
            nominal = None if role == "inferred" else 0.0
            members.append(Toy(f"{name}{i}", -half, half, nominal))
            roles[f"{name}{i}"] = Role(role)
    for i, sd in enumerate(measured):
        members.append(Toy(f"m{i}", -1e3 * sd, 1e3 * sd, 0.0))
        roles[f"m{i}"] = Role("measured", sd)
    for name, low, high in ends:
        one = next(each for each in members if each.name == name)
        one.low, one.high = low, high
    return Inputs({}, members, roles)


def linear(inputs: Inputs, d: int, seed: int = 0, noise: float = 0.1, error: float = 0.03):
    """A linear function of the inputs with D outputs: slopes (D, K), and the emulator."""
    rng = np.random.default_rng(seed)
    slopes = torch.as_tensor(rng.normal(size=(d, len(inputs))))
    half = torch.as_tensor(error * rng.normal(size=(d, d)))
    return slopes, Emulator(lambda x: x @ slopes.mT, half @ half.mT)


def known_noise(d: int, sd: float = 0.1) -> Noise:
    return Noise(torch.full((d,), sd, dtype=torch.float64))


def linear_problem(inputs: Inputs, d: int, truth, seed: int = 0, sd: float = 0.1, **rest):
    """Potential of a linear problem with data drawn at `truth` (K,), its slopes (D, K), and the
    covariance (D, D) of errors and noise together."""
    slopes, emulator = linear(inputs, d, seed)
    covariance = emulator.error + sd**2 * torch.eye(d, dtype=torch.float64)
    rng = np.random.default_rng(seed + 100)
    noise = torch.linalg.cholesky(covariance) @ torch.as_tensor(rng.normal(size=d))
    y = slopes @ torch.as_tensor(np.asarray(truth, dtype=float)) + noise
    return Potential(emulator, inputs, y, known_noise(d, sd), **rest), slopes, covariance


def closed_form(potential, slopes, covariance, members=()):
    """Log evidence, and mean (n,) and covariance (n, n) of the n free inputs, of a linear problem
    whose ranges are wide."""
    inputs = potential.inputs
    free = potential.free(members)
    precision, width = torch.zeros(len(inputs)).double(), 0.0
    logs = 0.0
    for k in np.flatnonzero(free.numpy()):
        if inputs.roles[k].kind == "measured":
            precision[k] = inputs.roles[k].sd ** -2
            logs += 0.5 * float(precision[k].log()) - 0.5 * np.log(2 * np.pi)
        else:
            width += float(potential.width[k].log())
    j = slopes[:, free]
    weight = torch.linalg.inv(covariance)
    information = j.mT @ weight @ j + torch.diag(precision[free])
    posterior = torch.linalg.inv(information)
    nominal = torch.as_tensor(inputs.nominal)
    rest = potential.y - slopes @ torch.where(free, 0.0, nominal)
    mean = posterior @ (j.mT @ weight @ rest)
    residual = rest - j @ mean
    d, n = len(potential.y), int(free.sum())
    quadratic = residual @ weight @ residual + (precision[free] * mean.square()).sum()
    evidence = -0.5 * quadratic - 0.5 * torch.logdet(covariance) - 0.5 * d * np.log(2 * np.pi)
    evidence = evidence + 0.5 * torch.logdet(posterior) + 0.5 * n * np.log(2 * np.pi)
    return float(evidence) + logs - width, mean, posterior
