"""Torsion: how far one level of the wall turns against another, per distance between them."""

from typing import ClassVar

from regional_lv.quantities.base import LEVEL_PAIRS, Quantity, levels_of


class Torsion(Quantity):
    """Twist between two levels over their distance, deg/mm, with the loaded state as the reference.

    Positive where the lower level turns counter-clockwise against the upper one as seen from the
    apex, on the way from the loaded to the unloaded state, which is the usual sign of systolic
    torsion (Young and Cowan 2012, doi 10.1186/1532-429X-14-49). A level's rotation is the mean over
    its wall of the angle about the long axis; the distance is that of the levels' mean heights in
    the loaded state.
    """

    name, unit = "torsion", "deg/mm"
    units: ClassVar = {"deg/mm": 1.0}
    limits = (-2.0, 2.0)
    noise = "torsion"
    places = LEVEL_PAIRS
    default_places = ("basal-apical",)

    def densities(self, point):
        return {"rotation": point.rotation, "height": point.height}

    def values(self, motion, places):
        import torch

        found = []
        for upper, lower in map(levels_of, places):
            turn, down = (
                motion.level_mean(name, lower) - motion.level_mean(name, upper)
                for name in ("rotation", "height")
            )
            # Counter-clockwise seen from the base is clockwise seen from the apex, and looking
            # back turns the other way: both signs cancel.
            found.append(turn / -down)
        return torch.rad2deg(torch.stack(found))
