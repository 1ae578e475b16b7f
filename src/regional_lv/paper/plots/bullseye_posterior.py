"""Regional stiffness of one subject, the model as it is (the paper's Figure 11)."""

from pathlib import Path

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.case_posterior import read
from regional_lv.plots import style
from regional_lv.plots.bullseye_posterior import draw_posterior


@style.context
def draw(
    posterior: Path,
    diagnostics: Path,
    source: str,
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
    truth: Path | None = None,
) -> None:
    """`draw_posterior` of one (NetCDF) with its verdict (CSV). truth: JSON of a synthetic
    subject."""
    draw_posterior(read(posterior, diagnostics, truth=truth), source, parameters, png, csv)
