"""Evidence of many models at once, against closed forms and quadrature."""

import numpy as np
import pytest
import torch
from scipy import integrate, stats

from regional_lv.inference.evidence import cut, fit
from regional_lv.inference.evidence import integrate as integrated
from regional_lv.inference.potential import Potential
from tests.inference.toys import Emulator, closed_form, known_noise, linear_problem, toy_inputs


def fitted(potential, members=((),)):
    """The models of some sets of members, fitted from nominal values."""
    free = torch.stack([potential.free(m) for m in members])
    x = potential.nominal.repeat(len(free), 1)
    zero = torch.zeros(len(free)).double()
    return fit(potential, free, zero, x, potential.settle(x, zero), 60, 1e-9)


@pytest.mark.parametrize(
    ("mean", "sd", "low", "high"),
    [
        (0.3, 1.0, -1.0, 2.0),
        (0.0, 1.0, -np.inf, np.inf),
        (0.0, 1.0, 1.0, np.inf),
        (0.0, 1.0, -9.0, -6.0),
        (5.0, 0.1, 0.0, 1.0),
        (0.5, 50.0, 0.0, 1.0),
        (-3.0, 1e-3, 0.0, 1.0),
    ],
)
def test_cut(mean, sd, low, high):
    arguments = (torch.tensor(v, dtype=torch.float64) for v in (mean, sd**2, low, high))
    log_mass, centre, variance = map(float, cut(*arguments))
    a, b = (low - mean) / sd, (high - mean) / sd
    sign = -1 if a > 0 else 1  # where SciPy keeps its digits
    a, b = (a, b) if sign > 0 else (-b, -a)
    upper, lower = stats.norm.logcdf(b), stats.norm.logcdf(a)
    assert log_mass == pytest.approx(upper + np.log1p(-np.exp(lower - upper)), abs=1e-8)

    # Relative to the largest density within the interval.
    mode = np.clip(mean, low, high)
    scale = sd / max(1.0, abs(mode - mean) / sd)
    first, last = max(low, mode - 40 * scale), min(high, mode + 40 * scale)

    def moment(power):
        def weighted(t):
            exponent = ((mode - mean) ** 2 - (t - mean) ** 2) / (2 * sd**2)
            return (t - mode) ** power * np.exp(exponent)

        return integrate.quad(weighted, first, last, epsabs=0, epsrel=1e-8, limit=200)[0]

    m0, m1, m2 = map(moment, range(3))
    assert centre == pytest.approx(mode + m1 / m0, abs=1e-4 * scale)
    assert variance == pytest.approx(m2 / m0 - (m1 / m0) ** 2, rel=1e-4)


@pytest.mark.parametrize("correlation", [-0.9, -0.5, 0.0, 0.8])
@pytest.mark.parametrize("low", [-1.0, 0.5, 3.0])
def test_integral_in_two_dimensions(correlation, low):
    covariance = np.array([[1.0, correlation], [correlation, 1.0]])
    normal = stats.multivariate_normal([0, 0], covariance)
    t = np.linspace(low, low + 9, 1501)
    density = normal.pdf(np.stack(np.meshgrid(t, t, indexing="ij"), -1))

    def whole(values):
        return integrate.simpson(integrate.simpson(values, x=t), x=t)

    mass = whole(density)
    expected = [whole(density * t[:, None]) / mass, whole(density * t[None, :]) / mass]
    ends = torch.full((1, 2), low).double(), torch.full((1, 2), low + 9).double()
    precision = torch.linalg.inv(torch.as_tensor(covariance))[None]
    log_integral, mean, _ = integrated(torch.zeros(1, 2).double(), precision, *ends)
    log_mass = float(log_integral) - np.log(2 * np.pi) + 0.5 * float(torch.logdet(precision))
    exact = 1e-4 if correlation == 0 else 0.03
    assert log_mass == pytest.approx(np.log(mass), abs=exact)
    np.testing.assert_allclose(mean[0], expected, atol=exact)


def test_linear_problem():
    inputs = toy_inputs(3, measured=(0.3, 0.05), suspected=3, half=20.0)
    truth = [0.5, -0.3, 0.8, 0.0, 0.4, 0.0, 0.3, 0.0]
    potential, slopes, covariance = linear_problem(inputs, 12, truth)
    members = [(), (3,), (4,), (3, 5), (3, 4, 5)]
    found = fitted(potential, members)
    for row, some in enumerate(members):
        evidence, mean, posterior = closed_form(potential, slopes, covariance, some)
        free = potential.free(some)
        assert float(found.log_evidence[row]) == pytest.approx(evidence, abs=1e-5)
        torch.testing.assert_close(found.mean[row][free], mean, atol=1e-5, rtol=0)
        both = found.covariance[row][free][:, free]
        torch.testing.assert_close(both, posterior, atol=1e-8, rtol=1e-4)


@pytest.mark.parametrize("where", [-0.9, 0.0, 0.3, 0.98, 1.1, 3.0])
@pytest.mark.parametrize("slope", [0.02, 1.0])
def test_one_input_at_its_bound(where, slope):
    """A linear effect whose best value lies anywhere: evidence against quadrature."""
    inputs = toy_inputs(1, ends=(("t0", 0.0, 1.0),))
    d = 4
    emulator = Emulator(lambda x: slope * x.expand(-1, d), torch.zeros(d, d).double())
    y = torch.full((d,), slope * where).double() + 0.05 * torch.tensor([1.0, -1, 2, 0]).double()
    potential = Potential(emulator, inputs, y, known_noise(d))
    noise, observed = stats.norm(0, 0.1), y.numpy()

    def log_density(t):
        return noise.logpdf(observed - slope * t).sum()

    best = log_density(np.clip(observed.mean() / slope, 0, 1))

    def moment(power):
        def weighted(t):
            return t**power * np.exp(log_density(t) - best)

        return integrate.quad(weighted, 0, 1, points=[0.01, 0.99], epsabs=0, limit=200)[0]

    moments = [moment(power) for power in range(3)]
    found = fitted(potential)
    mean = moments[1] / moments[0]
    assert float(found.log_evidence) == pytest.approx(best + np.log(moments[0]), abs=1e-3)
    assert float(found.mean) == pytest.approx(mean, abs=1e-3)
    sd = np.sqrt(moments[2] / moments[0] - mean**2)
    assert float(found.covariance) ** 0.5 == pytest.approx(sd, rel=1e-2)


@pytest.mark.parametrize("at", [(0.5, 0.5), (1.3, 0.5), (1.3, 1.4), (-0.2, 1.5)])
def test_two_inputs_at_their_bounds(at):
    """Correlated effects whose best values lie inside the ranges, at an end, or in a corner."""
    inputs = toy_inputs(1, suspected=1, ends=(("t0", 0.0, 1.0), ("c0", 0.0, 1.0)))
    slopes = torch.tensor([[1.0, 0.7], [0.2, 0.9], [0.8, 0.8], [0.5, 0.1]]).double()
    emulator = Emulator(lambda x: x @ slopes.mT, torch.zeros(4, 4).double())
    y = slopes @ torch.tensor(at).double()
    potential = Potential(emulator, inputs, y, known_noise(4, 0.2))
    t = np.linspace(0, 1, 401)
    grid = np.stack(np.meshgrid(t, t, indexing="ij"), -1) @ slopes.numpy().T
    density = np.exp(stats.norm(0, 0.2).logpdf(y.numpy() - grid).sum(-1))
    expected = np.log(integrate.simpson(integrate.simpson(density, x=t), x=t))
    found = fitted(potential, [(1,)])
    assert float(found.log_evidence) == pytest.approx(expected, abs=0.05)


def test_what_the_data_do_not_see_keeps_its_prior():
    inputs = toy_inputs(2, suspected=1)
    potential, slopes, _ = linear_problem(inputs, 8, [0.2, 0.1, 0.0])
    slopes[:, 2] = 0
    found = fitted(potential, [(), (2,)])
    assert float(found.log_evidence.diff()) == pytest.approx(0.0, abs=1e-3)
    assert float(found.covariance[1, 2, 2]) == pytest.approx(4 / 12, rel=1e-3)


def test_measured_input_is_errors_in_common():
    """Integrated out, it adds its covariance to the noise."""
    inputs = toy_inputs(2, measured=(0.3,), half=30.0)
    potential, slopes, _ = linear_problem(inputs, 10, [0.5, -0.2, 0.35])
    with_input = fitted(potential)
    known = toy_inputs(2, half=30.0)
    pattern = slopes[:, 2]
    emulator = Emulator(
        lambda x: x @ slopes[:, :2].mT,
        potential.emulated.error + 0.3**2 * pattern[:, None] * pattern,
    )
    without = fitted(Potential(emulator, known, potential.y, potential.noise))
    assert float(with_input.log_evidence) == pytest.approx(float(without.log_evidence), abs=1e-5)
    torch.testing.assert_close(with_input.mean[:, :2], without.mean, atol=1e-5, rtol=0)
    both = with_input.covariance[:, :2, :2]
    torch.testing.assert_close(both, without.covariance, atol=1e-8, rtol=1e-4)
