"""Several effects at once, in closed form: in which order they act, and their derivatives."""

import math

import numpy as np
import pytest
import torch

from regional_lv.criticism.differences import Scale
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.extension import Extension
from regional_lv.criticism.hypotheses import REGISTRY
from regional_lv.emulators.base import Prediction
from regional_lv.errors import InputError
from tests.criticism.toy import CHANNELS, OUTPUTS, THETA, D, ToyEmulator

EMULATOR = ToyEmulator()
THETAS = torch.stack([THETA, THETA.flip(0)])


class Known(Extension):
    """A simulated hypothesis whose change of the logarithms is known: `size` times a wave, times
    how far psi is from its base on its scale, more of it in a soft wall."""

    def __init__(self, name, size=1.0, component="", outputs=OUTPUTS):
        super().__init__(REGISTRY[name], outputs, 2.0, component)
        self.size = size

    def change(self, theta, psi):
        h, at = self.hypothesis, torch.arange(D, dtype=torch.float64)
        far = (h.scale(psi) - h.scale(h.base))[..., None]
        return self.size * far * torch.sin(at) * (1 - 0.2 * theta.log().mean(-1, keepdim=True))

    def mean(self, outputs, theta, psi):
        return self._differences(outputs, self.change(theta, psi), psi)[0]

    def difference(self, outputs, theta, psi):
        found, slope = self._differences(outputs, self.change(theta, psi), psi)
        return Prediction(found, torch.diag_embed((1e-3 * slope).square()))


def closed(name):
    return Extension(REGISTRY[name], OUTPUTS, 2.0)


RADIAL = torch.as_tensor(CHANNELS.of_quantity("radial"))
VOLUME = torch.as_tensor(CHANNELS.of_quantity("volume"))


def logarithms(outputs):
    scale, none = Scale(CHANNELS, 2.0), np.zeros((*outputs.shape, 1))
    return torch.as_tensor(scale.logarithms(outputs.numpy(), none, 2.0)[0])


def scaled(extensions, *psi):
    at = [e.hypothesis.scale(p) for e, p in zip(extensions, psi, strict=True)]
    return torch.tensor(at, dtype=torch.float64).expand(len(THETAS), -1)


def test_changes_of_the_logarithms_add_up():
    one, other = Known("septal_load", 0.01), Known("fibre_rotation", -0.004)
    found = ExtendedEmulator(EMULATOR, [one, other]).mean(THETAS, scaled([one, other], 4.0, 10.0))
    expected = logarithms(EMULATOR.predict_mean(THETAS))
    for extension, psi in ((one, 4.0), (other, 10.0)):
        expected = expected + extension.change(THETAS, torch.full((2,), psi).double())
    torch.testing.assert_close(logarithms(found), expected)


@pytest.mark.parametrize("turn", [1, -1])
def test_strains_are_measured_and_reported_as_the_effect_left_them(turn):
    """Whatever the order in which the causes are listed."""
    effect, measure, report = Known("septal_load", 0.01), Known("strain_measure", 0.0), None
    report = closed("radial_scale")
    psi = {"septal_load": 4.0, "strain_measure": 1.0, "radial_scale": 0.7}
    listed = [effect, measure, report][::turn]
    both = ExtendedEmulator(EMULATOR, listed)
    found = both.mean(THETAS, scaled(listed, *(psi[e.hypothesis.name] for e in listed)))
    green = ExtendedEmulator(EMULATOR, [effect]).mean(THETAS, scaled([effect], 4.0))
    nominal = (1 + 2 * green).sqrt() - 1
    expected = torch.where(VOLUME, green, torch.where(RADIAL, 0.7 * nominal, nominal))
    torch.testing.assert_close(found, expected)


def test_another_load_acts_on_all_effects():
    """At half the load a spring is twice as compliant against the stresses; the volume is of the
    whole load."""
    spring, frames = Known("basal_motion", 0.02), closed("mixed_frames")
    both = ExtendedEmulator(EMULATOR, [frames, spring])
    found = both.mean(THETAS, scaled([frames, spring], 0.5, 2.0))
    alone, softer = ExtendedEmulator(EMULATOR, [spring]), THETAS.clone()
    softer[:, 0::2] *= 2
    late = alone.mean(THETAS, scaled([spring], 2.0))
    early = alone.mean(softer, scaled([spring], 1.0))
    torch.testing.assert_close(found, torch.where(VOLUME, late, early))


def test_pressure_and_frames_multiply():
    pressure, frames = closed("end_diastolic_pressure"), closed("mixed_frames")
    for listed, psi in (([pressure, frames], (16.0, 0.5)), ([frames, pressure], (0.5, 16.0))):
        found = ExtendedEmulator(EMULATOR, listed).mean(THETAS, scaled(listed, *psi))
        softer = THETAS.clone()
        softer[:, 0::2] /= 2
        as_assumed, doubled = EMULATOR.predict_mean(THETAS), EMULATOR.predict_mean(softer)
        torch.testing.assert_close(found, torch.where(VOLUME, doubled, as_assumed))


EVERY = {
    "end_diastolic_pressure": (closed("end_diastolic_pressure"), 9.0),
    "septal_load": (Known("septal_load", 0.01), 4.0),
    "radial_scale": (closed("radial_scale"), 0.8),
    "basal_motion": (Known("basal_motion", 0.02), 3.0),
    "mixed_frames": (closed("mixed_frames"), 0.2),
    "strain_measure": (Known("strain_measure", 0.01), 0.5),
}


@pytest.mark.parametrize("base", [False, True])
def test_derivatives_are_those_of_the_mean(base):
    """Of all kinds of effects at once, at values and at the base."""
    extensions = [e for e, _ in EVERY.values()]
    psi = [e.hypothesis.base if base else value for e, value in EVERY.values()]
    both, at = ExtendedEmulator(EMULATOR, extensions), scaled(extensions, *psi)
    mean, by_log_theta, by_scaled = both.linearise(THETAS, at)
    torch.testing.assert_close(mean, both.mean(THETAS, at))
    h = 1e-5
    for i in range(10):
        step = torch.zeros(10).double()
        step[i] = h
        sides = [both.mean(THETAS * torch.exp(s * step), at) for s in (1, -1)]
        slope = (sides[0] - sides[1]) / (2 * h)
        torch.testing.assert_close(by_log_theta[..., i], slope, rtol=1e-3, atol=2e-5)
    for i, extension in enumerate(extensions):
        own = extension.hypothesis
        h = 1e-5 * (own.scale(own.high) - own.scale(own.low))
        step = torch.zeros(len(extensions)).double()
        step[i] = h
        back = 0.0 if base and own.base <= own.low else 1.0
        slope = (both.mean(THETAS, at + step) - both.mean(THETAS, at - back * step)) / (
            h + back * h
        )
        size = float(slope.abs().max())
        torch.testing.assert_close(by_scaled[..., i], slope, rtol=2e-3, atol=2e-3 * size)


def test_an_inactive_cause_changes_nothing_and_has_no_derivative():
    extensions = [e for e, _ in EVERY.values()]
    at = scaled(extensions, *(e.hypothesis.base for e in extensions)).clone()
    at[:, 1] = 4.0
    active = torch.zeros(2, len(extensions), dtype=torch.bool)
    active[:, 1] = True
    mean, _, by_scaled = ExtendedEmulator(EMULATOR, extensions).linearise(THETAS, at, active)
    alone = ExtendedEmulator(EMULATOR, [extensions[1]])
    torch.testing.assert_close(mean, alone.mean(THETAS, at[:, 1:2]))
    assert (by_scaled[..., [0, 2, 3, 4, 5]] == 0).all() and (by_scaled[..., 1] != 0).any()


def test_a_signature_is_the_derivative_beside_the_other_effects():
    """Of one of the extensions, and of one more."""
    extensions = [EVERY["strain_measure"][0], EVERY["radial_scale"][0]]
    at = scaled(extensions, 0.5, 0.8)
    more = EVERY["septal_load"][0]
    both = ExtendedEmulator(EMULATOR, extensions)
    found = both.signature(more, THETAS, at)
    all_at = scaled([*extensions, more], 0.5, 0.8, more.hypothesis.base)
    expected = both.with_extensions(more).linearise(THETAS, all_at)[2][..., 2]
    torch.testing.assert_close(found, expected, rtol=1e-2, atol=1e-5)
    own = both.signature(extensions[1], THETAS, at)
    beside = ExtendedEmulator(EMULATOR, extensions[:1]).mean(THETAS, at[:, :1])
    torch.testing.assert_close(own, torch.where(RADIAL, beside, 0.0))


def test_errors_go_through_what_comes_after_them():
    """Radial strains that are reported at half have half of the errors."""
    listed = [EVERY["septal_load"][0], closed("radial_scale")]
    both = ExtendedEmulator(EMULATOR, listed)
    whole = both.predict(THETAS, scaled(listed, 4.0, 1.0)).covariance
    half = both.predict(THETAS, scaled(listed, 4.0, 0.5)).covariance
    factor = torch.where(RADIAL, 0.5, 1.0).double()
    torch.testing.assert_close(half, factor[:, None] * whole * factor)
    assert math.isclose(float(whole[0, 20, 20] / half[0, 20, 20]), 4.0, rel_tol=1e-5)


def test_extensions_of_other_outputs_are_refused():
    with pytest.raises(InputError, match=r"septal_load: .* select the same of both"):
        ExtendedEmulator(EMULATOR, [Known("septal_load", outputs=OUTPUTS[:5])])
