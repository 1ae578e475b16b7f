"""What every emulator does, on a toy of the simulator."""

from typing import Any, ClassVar

import numpy as np
import pytest
import torch

from regional_lv import emulators
from regional_lv.emulators.base import Emulator, SeparablePrediction
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.testing.contract import Contract

PARAMETERS = StiffnessInputs()
NAMES = ("volume_ml", "circumferential_01", "radial_01", "radial_02", "longitudinal_05")
TOY: dict[str, Any] = {"parameters": PARAMETERS, "outputs": NAMES}
ROWS = 150


def toy(theta):
    """Five smooth outputs of the ten parameters, on scales as different as volume and strain."""
    x = torch.log(torch.as_tensor(theta))
    first = torch.tensor([0.5, 0.3, 0.2, 0.4, 0.1], dtype=x.dtype)
    second = torch.tensor([0.2, 0.1, 0.3, 0.1, 0.2], dtype=x.dtype)
    a, b = x[..., ::2] @ first, x[..., 1::2] @ second
    columns = [150 - 20 * torch.tanh(a), -0.2 + 0.05 * a, torch.exp(-a), 0.3 * torch.sin(b)]
    return torch.stack([*columns, 0.05 * (a * b + 0.1 * b)], dim=-1)


def toy_slopes(theta):
    """d(toy)/d(theta), (N, 5, 10)."""
    slopes = torch.func.vmap(torch.func.jacrev(toy))(torch.as_tensor(theta))
    return slopes.numpy()


def points(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 5.0, size=(n, 10))


MIDDLE = torch.as_tensor(1 + 0.6 * points(3, 6))


def fit_toy(emulator: Emulator, theta: np.ndarray) -> Emulator:
    return emulator.fit(theta, toy(theta), toy_slopes(theta), seed=3, **TOY)


def predictions(fitted, theta):
    """Means and standard deviations (N, 5) of each row by the emulator of its own outputs."""
    with torch.no_grad():
        each = [fitted.localise(toy(t)).predict(t) for t in torch.as_tensor(theta)]
    return torch.stack([p.mean for p in each]), torch.stack([p.sd for p in each])


class EmulatorContract(Contract):
    """Of an `emulators.base.Emulator`.

    settings: with which it is fast on 150 simulations and accurate enough, if its defaults are not.
    """

    registry = emulators.REGISTRY
    settings: ClassVar[dict] = {}

    @pytest.fixture(scope="class")
    @classmethod
    def create(cls, kind):
        """Makes an emulator that has learnt nothing, with further settings."""
        return lambda **further: emulators.create(kind.name, cls.settings | further)

    @pytest.fixture(scope="class")
    @classmethod
    def fitted(cls, create):
        """As it comes out of `fit`."""
        return fit_toy(create(), points(ROWS, 1))

    @pytest.fixture(scope="class")
    @classmethod
    def emulator(cls, fitted):
        """Ready to predict: what is local has an observation from the middle of the box."""
        return fitted.localise(toy(MIDDLE[0]))

    @pytest.fixture(scope="class")
    @classmethod
    def held_out(cls, fitted):
        """Errors and standard deviations (N, 5), in training sd, at points not trained on; fewer of
        an emulator that trains at each."""
        local = emulators.architecture_of(fitted.name).training_scope == "local"
        theta = points(16 if local else 40, 4)
        mean, sd = predictions(fitted, theta)
        return (mean - toy(theta)) / fitted.output_sd, sd / fitted.output_sd

    def test_shapes(self, emulator):
        for shape in ((), (4,), (2, 3)):
            prediction = emulator.predict(torch.ones(*shape, 10, dtype=torch.float64))
            assert prediction.mean.shape == (*shape, 5)
            assert prediction.covariance.shape == (*shape, 5, 5)
            assert prediction.sd.shape == (*shape, 5)

    def test_covariance_is_positive_definite(self, emulator):
        covariance = emulator.predict(torch.as_tensor(points(20, 2))).covariance
        scaled = covariance / torch.outer(emulator.output_sd, emulator.output_sd)
        assert torch.linalg.eigvalsh(scaled).min() > 0
        assert torch.equal(covariance, covariance.mT) or torch.allclose(covariance, covariance.mT)

    def test_many_rows_as_one_by_one(self, emulator):
        theta = torch.as_tensor(points(7, 21))
        together = emulator.predict(theta)
        for i, row in enumerate(theta):
            alone = emulator.predict(row)
            # Products of matrices round differently, and weights are large where K is stiff.
            gap = (together.mean[i] - alone.mean) / emulator.output_sd
            assert gap.abs().max() < 1e-7
            torch.testing.assert_close(together.sd[i], alone.sd, rtol=1e-6, atol=0)

    def test_error_on_held_out_points(self, held_out):
        """A constant errs by 1."""
        assert held_out[0].square().mean().sqrt() < 0.25

    def test_intervals_hold_what_they_promise(self, held_out):
        error, sd = held_out
        assert 0.88 < (error.abs() < 1.96 * sd).double().mean() <= 1.0
        # Wide enough is not enough.
        assert sd.mean() < 0.5

    def test_gradients_against_finite_differences(self, emulator):
        def values(theta):
            prediction = emulator.predict(theta)
            log_sd = prediction.sd.log()
            return torch.cat([prediction.mean / emulator.output_sd, log_sd], dim=-1)

        theta = MIDDLE.clone().requires_grad_(True)
        gradients = [
            torch.autograd.grad(v.sum(), theta, retain_graph=True)[0] for v in values(theta).T
        ]
        # Steps large enough for a variance that is what is left of 1 minus a sum of squares.
        for i, step in enumerate(1e-3 * torch.eye(10, dtype=torch.float64)):
            with torch.no_grad():
                numeric = (values(MIDDLE + step) - values(MIDDLE - step)) / 2e-3
            analytic = torch.stack([gradient[:, i] for gradient in gradients], dim=1)
            torch.testing.assert_close(analytic, numeric, rtol=1e-3, atol=1e-4)

    def test_jacobian_is_that_of_autograd(self, emulator):
        theta = torch.as_tensor(points(4, 7)).reshape(2, 2, 10)
        own, expected = emulator.jacobian(theta), Emulator.jacobian(emulator, theta)
        for a, b in zip(own, expected, strict=True):
            # Small entries are differences of large numbers.
            largest = 0.0 if b is None else float(b.abs().max())
            torch.testing.assert_close(a, b, rtol=0, atol=1e-9 * largest)

    def test_mean_alone_is_that_of_the_prediction(self, emulator):
        theta = torch.as_tensor(points(6, 24)).reshape(2, 3, 10)
        torch.testing.assert_close(emulator.predict_mean(theta), emulator.predict(theta).mean)
        torch.testing.assert_close(emulator.linearise(theta)[1], emulator.jacobian(theta)[0])

    def test_gradient_of_the_mean_alone_and_of_a_prediction_with_another_variance(self, emulator):
        theta = torch.as_tensor(points(4, 25)).requires_grad_(True)
        weights = torch.arange(1.0, 1.0 + len(emulator.outputs), dtype=theta.dtype)
        slopes = [
            torch.autograd.grad((mean * weights).sum(), theta)[0]
            for mean in (emulator.predict(theta).mean, emulator.predict_mean(theta))
        ]
        torch.testing.assert_close(*slopes)
        if isinstance(emulator.predict(theta), SeparablePrediction):
            variance = torch.full((4,), 0.3, dtype=theta.dtype)
            other = emulator.with_variance(theta, variance)
            torch.testing.assert_close(other.mean, emulator.predict(theta).mean)
            torch.testing.assert_close(other.variance, variance)

    def test_architecture_is_said(self, fitted):
        kind = emulators.architecture_of(fitted.name)
        assert kind.training_scope in ("local", "global") and kind.label
        assert kind.output_structure in ("single-output", "multi-output")

    def test_file_brings_it_back(self, fitted, emulator, tmp_path):
        theta = torch.as_tensor(points(5, 8))
        for before in (emulator, fitted):
            before.save(tmp_path / "emulator.pt")
            loaded = emulators.load(tmp_path / "emulator.pt")
            assert loaded.outputs == NAMES and loaded.info == fitted.info
            assert torch.equal(loaded.outside(theta), fitted.outside(theta))
            a, b = emulator.predict(theta), loaded.localise(toy(MIDDLE[0])).predict(theta)
            assert torch.equal(a.mean, b.mean) and torch.equal(a.covariance, b.covariance)

    def test_some_outputs_alone(self, emulator):
        names = ("radial_02", "volume_ml")
        theta = torch.as_tensor(points(5, 9))
        whole, part = emulator.predict(theta), emulator.select(names).predict(theta)
        index = [NAMES.index(name) for name in names]
        torch.testing.assert_close(part.mean, whole.mean[:, index])
        torch.testing.assert_close(part.covariance, whole.covariance[:, index][:, :, index])
        with pytest.raises(InputError, match="radial_17"):
            emulator.select(["radial_17"])

    def test_same_seed_same_emulator(self, create, emulator):
        again = fit_toy(create(), points(ROWS, 1)).localise(toy(MIDDLE[0]))
        at = torch.as_tensor(points(5, 10))
        a, b = again.predict(at), emulator.predict(at)
        assert torch.equal(a.mean, b.mean) and torch.equal(a.covariance, b.covariance)

    def test_says_where_it_knows_nothing(self, fitted):
        inside = torch.as_tensor(points(ROWS, 1))
        assert fitted.outside(inside).double().mean() < 0.02
        far = torch.full((2, 10), 7.0, dtype=torch.float64)
        assert fitted.outside(far).all() and fitted.outside(far[0]).shape == ()

    def test_identity_inputs(self, create):
        """The paper's: harder for this toy, but not hopeless."""
        natural = fit_toy(create(input_transform="identity"), 0.5 + points(ROWS, 22))
        at = 0.5 + points(10, 23)
        mean, _ = predictions(natural, at)
        error = (mean - toy(at)) / natural.output_sd
        assert error.square().mean().sqrt() < 0.35

    def test_refuses_what_it_cannot_learn_from(self, create):
        theta = points(30, 11)
        y, slopes = toy(theta).numpy(), toy_slopes(theta)
        with pytest.raises(InputError, match="too few"):
            create().fit(theta[:8], y[:8], slopes[:8], **TOY)
        with pytest.raises(InputError, match="do not fit"):
            create().fit(theta[:, :9], y, slopes, **TOY)
        with pytest.raises(InputError, match="do not fit"):
            create().fit(theta, y[:, :4], slopes, **TOY)
        joined = [np.concatenate([part, part[5:7]]) for part in (theta, y, slopes)]
        with pytest.raises(InputError, match="rows 5 and 30 have the same theta"):
            create().fit(*joined, **TOY)
        still = theta.copy()
        still[:, 3] = 1.0
        if create().learns_from_sensitivities:
            # These say what an input does that is the same everywhere.
            assert create().fit(still, y, slopes, **TOY).info["rows"] == len(y)
        else:
            with pytest.raises(InputError, match=f"{PARAMETERS.names[3]} has one and the same"):
                create().fit(still, y, slopes, **TOY)
        still[:, 3] = np.arange(30)
        with pytest.raises(InputError, match="a factor is not above zero; correct the design"):
            create().fit(still, y, slopes, **TOY)
        y[4, 2] = np.nan
        with pytest.raises(InputError, match="row 4"):
            create().fit(theta, y, slopes, **TOY)
        y[:, 2] = 0.1  # whose standard deviation round-off makes larger than zero
        with pytest.raises(InputError, match="radial_01"):
            create().fit(theta, y, slopes, **TOY)
