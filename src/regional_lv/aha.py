"""Names, numbers and orders: the AHA segments, the five zones, the parameters and the outputs.

Inside the project, segments carry the official numbers of the 17-segment model of the American
Heart Association (doi 10.1161/hc0402.102975). The paper's data files order them differently
(`published_order`); `published_to_aha` and `aha_to_published` convert at import and export.
"""

from typing import NamedTuple

import numpy as np


class Segment(NamedTuple):
    """One AHA segment: official number (1-17), name, zone, 1-based place in the published order."""

    number: int
    name: str
    zone: str
    published_order: int


SEGMENTS = (
    Segment(1, "basal anterior", "anterior", 3),
    Segment(2, "basal anteroseptal", "septal", 2),
    Segment(3, "basal inferoseptal", "septal", 1),
    Segment(4, "basal inferior", "inferior", 6),
    Segment(5, "basal inferolateral", "lateral", 5),
    Segment(6, "basal anterolateral", "lateral", 4),
    Segment(7, "mid anterior", "anterior", 9),
    Segment(8, "mid anteroseptal", "septal", 8),
    Segment(9, "mid inferoseptal", "septal", 7),
    Segment(10, "mid inferior", "inferior", 12),
    Segment(11, "mid inferolateral", "lateral", 11),
    Segment(12, "mid anterolateral", "lateral", 10),
    Segment(13, "apical anterior", "apical", 14),
    Segment(14, "apical septal", "apical", 13),
    Segment(15, "apical inferior", "apical", 16),
    Segment(16, "apical lateral", "apical", 15),
    Segment(17, "apex", "apical", 17),
)

ZONES = ("anterior", "inferior", "lateral", "septal", "apical")
"""The paper's order of the zones, z = 1 ... 5."""

ZONE_COLOURS = {
    "anterior": "#0072B2",
    "inferior": "#F0E442",
    "lateral": "#009E73",
    "septal": "#CC79A7",
    "apical": "#E69F00",
}
"""The paper's zone colours (blue, yellow, green, pink, orange), from the Okabe-Ito palette."""

LEVELS = {"basal": range(1, 7), "mid": range(7, 13), "apical": range(13, 17), "apex": range(17, 18)}

PARAMETERS = tuple(f"{c}_{zone}" for zone in ZONES for c in ("C_a", "C_b"))
"""The ten scaling factors theta in the paper's order."""

IS_C_A = np.array([name.startswith("C_a") for name in PARAMETERS])
"""Which of them (10,) scale the a-type constants, and with them all stresses."""

DIRECTIONS = ("circumferential", "radial", "longitudinal")

OUTPUTS = ("volume_ml", *(f"{q}_{s.number:02d}" for q in DIRECTIONS for s in SEGMENTS))
"""The 52 observables: end-diastolic volume (mL), then strains by direction and AHA segment."""

SEGMENT_ZONE = np.array([ZONES.index(s.zone) for s in SEGMENTS])
"""Zone index (0-4) of segment number i + 1."""

published_to_aha = np.array([s.published_order - 1 for s in SEGMENTS])
"""`published[..., published_to_aha]` puts 17 values in published order into AHA order."""

aha_to_published = np.argsort(published_to_aha)
"""`aha[..., aha_to_published]` puts 17 values in AHA order into the published order."""


def outputs_from_published(table: np.ndarray) -> np.ndarray:
    """Reorder rows of 52 published outputs (V, then strains in three directions) to `OUTPUTS`."""
    blocks = [1 + 17 * d + published_to_aha for d in range(3)]
    return table[..., np.concatenate([[0], *blocks])]
