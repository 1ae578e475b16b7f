"""Measured files: read, checked and made."""

from regional_lv.measured.curves import import_curves, read_curve_subject
from regional_lv.measured.synthetic import synthetic_subject
from regional_lv.measured.tables import (
    MeasuredWarning,
    import_measured,
    read_measured,
    shortcomings,
    states_noise,
    write_measured,
)

__all__ = [
    "MeasuredWarning",
    "import_curves",
    "import_measured",
    "read_curve_subject",
    "read_measured",
    "shortcomings",
    "states_noise",
    "synthetic_subject",
    "write_measured",
]
