"""What the model as it is predicts for each channel (the paper's Figure 12)."""

from pathlib import Path

from regional_lv.paper.case_posterior import read
from regional_lv.plots import style
from regional_lv.plots.posterior_predictive import draw_posterior


@style.context
def draw(posterior: Path, diagnostics: Path, source: str, png: Path, csv: Path) -> None:
    """`draw_posterior` of one (NetCDF) with its verdict (CSV)."""
    draw_posterior(read(posterior, diagnostics), source, png, csv)
