"""Posterior correlations of zones, averaged over the cases of a set (the paper's Figure 10)."""

from collections.abc import Sequence
from pathlib import Path

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.plots import scenarios
from regional_lv.paper.plots.correlations import matrix, read
from regional_lv.paper.posteriors import verdicts
from regional_lv.plots import bullseye, style


@style.context
def draw(
    correlations: Sequence[Path],
    recoveries: Sequence[Path],
    labels: Sequence[str],
    title: str,
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw the correlations of the zones' first components, mean ± standard error.

    correlations: `zone_correlations.csv` (zone_1, zone_2, mean, se, cases) of the sets `labels`;
    recoveries: `recovery.csv` of the same, for verdicts. The table: set and the columns above.
    """
    joined = read(correlations, labels)
    zones = len(parameters.zones)
    side = 3.1 if zones <= bullseye.FEW_ZONES else 0.5 * zones
    fig = style.figure(max(side * len(labels) + 1, 6.0), side + 1.1)
    axes = scenarios.panels(fig, 1, len(labels))[0]
    for ax, label in zip(axes, labels, strict=True):
        part = joined[joined["set"] == label]
        image = matrix(ax, part, "zone", parameters.zone_names, style.zone_label)
        ax.set_title(f"{label} ({part['cases'].max()} cases)")
    for ax in axes[1:]:
        ax.set_yticklabels([])
    fig.colorbar(image, ax=list(axes), label="posterior correlation", shrink=0.75)
    warning = verdicts.warning_of_sets(verdicts.read_sets(recoveries, labels, parameters))
    style.suptitle(fig, title, warning)
    style.save(fig, joined, png, csv)
