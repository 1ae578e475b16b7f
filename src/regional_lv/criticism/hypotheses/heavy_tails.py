"""Noise with outliers."""

from regional_lv.criticism.hypotheses.base import NoiseHypothesis


class HeavyTails(NoiseHypothesis):
    name = "heavy_tails"
    parameter = "inverse of the degrees of freedom"
    unit = "1"
    base, low, high = 0.0, 0.0, 0.4
    description = (
        "A lost tag, a papillary muscle taken for wall, a slice moved by breathing: single "
        "channels are far off while the others are as exact as ever. Student's t noise with the "
        "channels' sd as its scale and psi = 1 / nu; at 0 it is Gaussian, at 0.4 (nu = 2.5) one "
        "channel in ten is off by more than 2.6 sd. No physics changes, and theta is kept from "
        "following outliers."
    )
    source = (
        "Lange, Little and Taylor 1989, J Am Stat Assoc 84:881-896, doi "
        "10.1080/01621459.1989.10478852"
    )

    def noise(self, shape, value, rng):
        return rng.standard_t(1 / value, shape) if value else rng.standard_normal(shape)
