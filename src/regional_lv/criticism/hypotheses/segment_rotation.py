"""Segments counted from another angle."""

from regional_lv.criticism.hypotheses.base import ObservationHypothesis


class SegmentRotation(ObservationHypothesis):
    name = "segment_rotation"
    parameter = "rotation of the segments"
    unit = "deg"
    base, low, high = 0.0, -15.0, 15.0
    path = ("observables", "segment_rotation_deg")
    nodes = (-15.0, -7.5, 7.5, 15.0)
    description = (
        "The sectors of a slice are counted from where the right ventricle meets the septum, a "
        "point that is set by hand and moves between slices and frames. Psi turns the borders of "
        "the measured segments against the simulated ones, counter-clockwise seen from the base: "
        "each segment reports part of its neighbour's strain, most where zones differ."
    )
    source = "Cerqueira et al. 2002, Circulation 105:539-542, doi 10.1161/hc0402.102975"
