"""What the figures of stiffening scenarios share: colours and panels of the sets."""

import numpy as np
from matplotlib.figure import Figure

from regional_lv.plots import style

COLOURS = (style.SKY, style.BLUE, style.BLACK, style.ORANGE, style.GREEN, style.PINK)
MARKERS = ("o", "s", "^", "D", "v", "P")


def look(at: int) -> tuple[str, str]:
    """Colour and marker of the set number `at`."""
    return COLOURS[at % len(COLOURS)], MARKERS[at % len(MARKERS)]


def panels(fig: Figure, rows: int, columns: int, **options) -> np.ndarray:
    """Axes (rows, columns), always two-dimensional."""
    return fig.subplots(rows, columns, squeeze=False, **options)
