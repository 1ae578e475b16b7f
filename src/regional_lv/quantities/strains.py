"""Segmental strains along the wall's local directions, with the loaded state as the reference."""

from regional_lv.quantities.base import SEGMENT_PLACES, Quantity


class Strain(Quantity):
    """Mean over a segment of the strain along one direction of the loaded configuration."""

    noise = "strain"
    places = SEGMENT_PLACES
    is_strain = True

    def densities(self, point):
        return {self.name: point.strains[self.name]}

    def values(self, motion, places):
        return motion.segment_means(self.name)[[int(place) - 1 for place in places]]


class Circumferential(Strain):
    name, sign, limits = "circumferential", -1, (-0.5, 1.5)


class Radial(Strain):
    name, sign, limits = "radial", 1, (-0.5, 3.0)


class Longitudinal(Strain):
    name, sign, limits = "longitudinal", -1, (-0.5, 1.5)
