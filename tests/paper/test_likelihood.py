"""The likelihood against SciPy, its two paths against each other, its derivatives."""

import math

import numpy as np
import pytest
import torch
from scipy import stats

from regional_lv.emulators.base import Emulator, Prediction, SeparablePrediction
from regional_lv.errors import InputError
from regional_lv.inference.noise import Noise
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.sampler.likelihood import Likelihood, inflate

PARAMETERS = StiffnessInputs()
DIRECTIONS = ("circumferential", "radial", "longitudinal")
OUTPUTS = ("volume_ml", *(f"{d}_{s:02d}" for s in (1, 4, 7, 9) for d in DIRECTIONS))


class LinearEmulator(Emulator):
    """Mean `base + slopes theta`, covariance `matrix` times exp(growth * sum(log theta)).

    An emulator with known answers: with growth 0 and bounds far away the posterior is Gaussian.
    """

    name = "linear"
    parameters = PARAMETERS

    def __init__(self, slopes, base, matrix, growth=0.0, separable=True, freedom=math.inf):
        super().__init__(input_transform="identity")
        self.slopes, self.base, self.matrix = slopes, base, matrix
        self.growth, self.separable, self.freedom = growth, separable, freedom
        self.outputs = OUTPUTS
        self.output_sd = torch.linspace(0.5, 1.5, len(OUTPUTS), dtype=torch.float64)

    def _predict(self, theta):
        mean = self.base + theta @ self.slopes.T
        variance = torch.exp(self.growth * theta.log().sum(-1))
        if self.separable:
            return SeparablePrediction(mean, variance, self.matrix, freedom=self.freedom)
        return Prediction(mean, variance[..., None, None] * self.matrix)

    def _fit(self, x, y, seed): ...
    def _select(self, index): ...
    def _restore(self, state): ...
    def _state(self):
        return {}


def linear(
    error: float, growth: float = 0.0, separable: bool = True, freedom: float = math.inf
) -> LinearEmulator:
    rng = np.random.default_rng(1)
    d = len(OUTPUTS)
    half = np.eye(d) + 0.3 * rng.normal(size=(d, d))
    slopes, base, matrix = rng.normal(size=(d, 10)), rng.normal(size=d), error**2 * half @ half.T
    tensors = (torch.as_tensor(a) for a in (slopes, base, matrix))
    return LinearEmulator(*tensors, growth, separable, freedom)


THETA = torch.as_tensor(np.random.default_rng(2).uniform(0.5, 4.0, size=(3, 10)))


def inferred(emulator: LinearEmulator, prior_scale: float) -> Noise:
    """Of values like `base` that came without sd."""
    none = np.full(len(emulator.outputs), np.nan)
    return Noise.of_subject(emulator, emulator.base.numpy(), none, prior_scale)


def noises(emulator: LinearEmulator) -> dict[str, Noise]:
    sd = torch.full((len(OUTPUTS),), 0.2, dtype=torch.float64)
    sd[0] = float("nan")
    return {
        "none": Noise.none(emulator),
        "known": Noise.known(sd),
        "inferred": inferred(emulator, 0.7),
    }


@pytest.mark.parametrize("separable", [True, False])
@pytest.mark.parametrize("kind", ["none", "known", "inferred"])
def test_against_scipy(kind, separable):
    emulator = linear(0.3, 0.1, separable)
    noise = noises(emulator)[kind]
    y = emulator.base + 2.0
    log_sigma = torch.tensor([[-1.0, 0.2, 0.5]] * 3, dtype=torch.float64)[:, : len(noise.groups)]
    density = Likelihood(emulator, y, noise).log_density(THETA, log_sigma)
    unit = np.array([0 if n == "volume_ml" else DIRECTIONS.index(n[:-3]) for n in OUTPUTS])
    for i, theta in enumerate(THETA):
        prediction = emulator.predict(theta)
        variance = np.zeros(len(OUTPUTS))
        if kind == "known":
            variance[1:] = 0.04
        elif kind == "inferred":
            sigma = np.exp([-1.0, 0.2, 0.5])
            variance = (sigma[unit] * emulator.output_sd.numpy()) ** 2
            variance[0] = (0.005 * emulator.base[0]) ** 2
        covariance = prediction.covariance.numpy() + np.diag(variance)
        expected = stats.multivariate_normal(prediction.mean.numpy(), covariance).logpdf(y.numpy())
        assert float(density[i]) == pytest.approx(expected, rel=1e-9)


def test_t_of_the_errors_against_scipy():
    emulator = linear(0.3, 0.1, freedom=7.0)
    y = emulator.base + 2.0
    density = Likelihood(emulator, y, Noise.none(emulator)).log_density(THETA)
    for theta, found in zip(THETA, density, strict=True):
        prediction = emulator.predict(theta)
        parts = (prediction.mean.numpy(), prediction.covariance.numpy())
        expected = stats.multivariate_t(*parts, df=7.0).logpdf(y.numpy())
        assert float(found) == pytest.approx(expected, rel=1e-9)
    # Beside measurement noise errors count as Gaussian.
    noise = noises(emulator)["known"]
    gaussian = Likelihood(linear(0.3, 0.1), y, noise).log_density(THETA)
    torch.testing.assert_close(Likelihood(emulator, y, noise).log_density(THETA), gaussian)


def test_draws_with_a_t_are_large_or_small_together():
    emulator, rows = linear(0.3, freedom=7.0), 20000
    generator = torch.Generator().manual_seed(1)
    theta, none = THETA[:1].expand(rows, 10), torch.zeros(rows, 0, dtype=torch.float64)
    draws = Likelihood(emulator, emulator.base, Noise.none(emulator)).draw(theta, none, generator)
    factor = torch.linalg.cholesky(emulator.matrix)
    errors = (draws - emulator.predict(THETA[0]).mean).T
    white = torch.linalg.solve_triangular(factor, errors, upper=False)
    d = len(white)
    share = stats.kstest(white.square().mean(0).numpy(), stats.f(d, 7.0).cdf)
    assert share.pvalue > 0.01


@pytest.mark.parametrize("freedom", [math.inf, 5.0])
@pytest.mark.parametrize("kind", ["none", "known", "inferred"])
def test_gradient_against_finite_differences(kind, freedom):
    emulator = linear(0.3, 0.1, freedom=freedom)
    noise = noises(emulator)[kind]
    likelihood = Likelihood(emulator, emulator.base + 2.0, noise)
    inputs = [THETA.clone().requires_grad_(True)]
    if noise.groups:
        inputs.append(torch.zeros(3, 3, dtype=torch.float64, requires_grad=True))
    assert torch.autograd.gradcheck(likelihood.log_density, inputs)


@pytest.mark.parametrize("kind", ["none", "known", "inferred"])
def test_information_is_the_expected_curvature(kind):
    """Monte-Carlo mean of score times score, over data drawn from the model."""
    emulator = linear(0.3, 0.1)
    noise = noises(emulator)[kind]
    n, groups = 20000, len(noise.groups)
    generator = torch.Generator().manual_seed(1)
    position = torch.cat([THETA[0].log(), torch.zeros(groups, dtype=torch.float64)])
    many = position.expand(n, -1).clone().requires_grad_(True)
    theta, log_sigma = many[:, :10].exp(), many[:, 10:]
    common = Likelihood(emulator, emulator.base, noise)
    y = common.draw(theta.detach(), log_sigma.detach(), generator)
    value = Likelihood(emulator, y, noise).log_density(theta, log_sigma)
    (score,) = torch.autograd.grad(value.sum(), many)
    simulated = score.T @ score / n
    likelihood = Likelihood(emulator, y[0], noise)
    information = likelihood.information(theta[0].detach(), log_sigma[0].detach())
    scale = information.diagonal().sqrt()
    difference = (simulated - information) / torch.outer(scale, scale)
    assert difference.abs().max() < 0.06


def test_emulator_uncertainty_enters():
    """The same residuals say less where the emulator knows less."""
    information = [
        Likelihood(e, e.base, Noise.none(e)).information(THETA[0])
        for e in (linear(0.1), linear(0.2))
    ]
    torch.testing.assert_close(information[0], 4 * information[1])


def test_errors_along_the_jacobian_have_a_variance_of_their_own():
    """The generalised least-squares estimate stays, its variance is `factor` times as large, and
    errors that no parameter explains are as likely as before."""
    emulator = linear(0.3)
    jacobian = emulator.slopes.clone()
    jacobian[:, 3] = 0.0  # moves no output
    moving = [i for i in range(10) if i != 3]
    inflated = inflate(emulator.matrix, jacobian, 2.5)

    def estimator(covariance):
        weighted = torch.linalg.solve(covariance, jacobian[:, moving]).T
        return torch.linalg.solve(weighted @ jacobian[:, moving], weighted)

    torch.testing.assert_close(estimator(inflated), estimator(emulator.matrix))
    before, after = (estimator(m) @ m @ estimator(m).T for m in (emulator.matrix, inflated))
    torch.testing.assert_close(after, 2.5 * before)
    torch.testing.assert_close(
        torch.linalg.slogdet(inflated).logabsdet,
        torch.linalg.slogdet(emulator.matrix).logabsdet + 9 * math.log(2.5),
    )


def test_determinant_enters():
    """With nothing to choose between the means, the density prefers the smaller covariance."""
    emulator = linear(0.3, 0.5)
    emulator.slopes = torch.zeros_like(emulator.slopes)
    likelihood = Likelihood(emulator, emulator.base, Noise.none(emulator))
    small, large = (torch.full((10,), t, dtype=torch.float64) for t in (0.5, 2.0))
    expected = 0.5 * len(OUTPUTS) * 0.5 * 10 * np.log(4.0)
    difference = likelihood.log_density(small) - likelihood.log_density(large)
    assert float(difference) == pytest.approx(expected)


def test_draws_have_the_covariance_of_the_likelihood():
    emulator = linear(0.3)
    noise = noises(emulator)["inferred"]
    theta = THETA[:1].expand(40000, -1)
    log_sigma = torch.tensor([[-1.0, 0.2, 0.5]], dtype=torch.float64).expand(40000, -1)
    generator = torch.Generator().manual_seed(2)
    y = Likelihood(emulator, emulator.base, noise).draw(theta, log_sigma, generator)
    expected = emulator.matrix + torch.diag(noise.variance(log_sigma[0]))
    scale = expected.diagonal().sqrt()
    assert ((y.T.cov() - expected) / torch.outer(scale, scale)).abs().max() < 0.04
    assert ((y.mean(0) - emulator.predict(THETA[0]).mean) / scale).abs().max() < 0.03


def test_a_covariance_without_factor_is_impossible_and_leaves_the_others_alone():
    emulator = linear(0.3)
    likelihood = Likelihood(emulator, emulator.base, inferred(emulator, 0.7))
    log_sigma = torch.zeros(3, len(likelihood.noise.groups), dtype=torch.float64)
    expected = likelihood.log_density(THETA, log_sigma)
    log_sigma[1, 0] = 400.0  # its square overflows
    theta = THETA.clone().requires_grad_()
    density = likelihood.log_density(theta, log_sigma)
    assert density[1] == -torch.inf
    torch.testing.assert_close(density[[0, 2]], expected[[0, 2]])
    (gradient,) = torch.autograd.grad(density.sum(), theta)
    assert torch.isfinite(gradient[[0, 2]]).all() and gradient[[0, 2]].abs().min() > 0


def test_one_unknown_scale_is_whitened_too():
    """The network's error scale: the fast path against the dense one."""
    emulator = linear(0.3, 0.1)
    noise = Noise.shared(emulator, 0.5)
    log_sigma = torch.tensor([[-1.0], [0.2], [0.5]], dtype=torch.float64)
    fast = Likelihood(emulator, emulator.base + 2.0, noise)
    dense = Likelihood(linear(0.3, 0.1, separable=False), emulator.base + 2.0, noise)
    assert fast._whiten is not None and dense._whiten is None
    torch.testing.assert_close(
        fast.log_density(THETA, log_sigma), dense.log_density(THETA, log_sigma)
    )


def test_noise_of_any_quantities_at_any_loads():
    """A scale for torsion beside those of the strains, the same at all loads; volumes without sd
    are known to half a percent."""
    names = ("radial_01", "volume_ml@0.5", "torsion_basal-apical", "radial_01@0.5", "volume_ml")
    emulator = linear(0.3)
    emulator.outputs, emulator.output_sd = names, torch.arange(1.0, 6.0, dtype=torch.float64)
    y, none = np.array([0.3, 150.0, 2.0, 0.2, 180.0]), np.full(5, np.nan)
    noise = Noise.of_subject(emulator, y, none, 0.7)
    assert list(noise.groups) == ["radial", "torsion"] and noise.prior_scale == 0.7
    assert noise.sd.tolist() == [0.0, 0.75, 0.0, 0.0, 0.9]
    assert noise.groups["radial"].tolist() == [1.0, 0.0, 0.0, 4.0, 0.0]
    assert noise.groups["torsion"].tolist() == [0.0, 0.0, 3.0, 0.0, 0.0]
    measured = Noise.of_subject(emulator, y, np.where(y == 150, 2.0, none), 0.7)
    assert list(measured.groups) == ["radial", "torsion"]
    assert measured.sd.tolist() == [0.0, 2.0, 0.0, 0.0, 0.9]
    known = Noise.of_subject(emulator, y, np.array([0.1, 2.0, 0.1, 0.1, np.nan]), 0.7)
    assert not known.groups and known.sd.tolist() == [0.1, 2.0, 0.1, 0.1, 0.9]
    some = Noise.of_subject(emulator, y, np.array([0.1, 2.0, np.nan, 0.1, 2.0]), 0.7)
    assert list(some.groups) == ["torsion"] and some.sd.tolist() == [0.1, 2.0, 0.0, 0.1, 2.0]


@pytest.mark.parametrize("value", [0.0, -0.01, np.inf])
def test_noise_that_cannot_be(value):
    emulator = linear(0.3)
    sd = np.full(len(OUTPUTS), 0.01)
    sd[2] = value
    with pytest.raises(InputError, match=f"{OUTPUTS[2]}.*give a number above 0"):
        Noise.of_subject(emulator, np.ones(len(sd)), sd, 1.0)
