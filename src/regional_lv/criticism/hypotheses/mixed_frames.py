"""Strains from another frame than the volume."""

from regional_lv.criticism.hypotheses.base import LoadHypothesis, mask_of

LATE = "volume"
"""The quantity that is end-diastolic in any case."""


class MixedFrames(LoadHypothesis):
    name = "mixed_frames"
    parameter = "share of the filling pressure missing in the strains"
    unit = "1"
    base, low, high = 0.0, 0.0, 0.6
    description = (
        "Volume and strains often come from different sequences, slices and frames, and the frame "
        "called end-diastolic is not the same in all. Psi is the share of the end-diastolic "
        "pressure that is missing where the strains are read, while the volume is end-diastolic: "
        "strains come out smaller than the volume implies. Closed form, as for the pressure: "
        "strains at the pressure (1 - psi) p are those of a wall with C_a / (1 - psi) at p."
    )
    source = (
        "Mada et al. 2015, JACC Cardiovasc Imaging 8:148-157; scaling: Holzapfel and Ogden 2009, "
        "doi 10.1098/rsta.2009.0091"
    )

    def why_not(self, physics):
        quantities = physics["observables"]["quantities"]
        if LATE not in quantities or len(quantities) < 2:
            return f"{LATE} and something else are not both observed (observables.quantities)"
        return super().why_not(physics)

    def load_fraction(self, channel, value):
        late = channel.quantity == LATE
        return channel.load_fraction * (1 if late else 1 - value)

    def share(self, psi):
        return 1 - psi

    def concerned(self, outputs):
        return ~mask_of(outputs, LATE)
