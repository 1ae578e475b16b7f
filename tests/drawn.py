"""What a figure or table that was made holds."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.image import imread


def read(paths: tuple[Path, Path]) -> pd.DataFrame:
    """The table beside a figure, once the figure has been seen to hold more than paper."""
    png, csv = paths
    assert np.ptp(imread(png)[..., :3]) > 0.5
    return pd.read_csv(csv)


def table_of(make, folder: Path, *arguments) -> pd.DataFrame:
    """What a function that writes a table has written."""
    files = {ending: folder / "tables" / f"made.{ending}" for ending in ("csv", "tex")}
    make(*arguments, **files)
    return pd.read_csv(files["csv"])
