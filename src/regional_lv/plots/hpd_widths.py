"""Widths of the 95 % HPD intervals in the stiffening scenarios (the paper's Figure 9)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.patches import Patch

from regional_lv.parameters import Parameterisation
from regional_lv.plots import scenarios, style

GROUPS = {
    "all parameters": style.GREY,
    "of the stiffened zone": style.VERMILLION,
    "of the other zones": style.SKY,
}
STATISTICS = ("cases", "q05", "q25", "median", "q75", "q95", "mean")


@style.context
def draw(
    recoveries: Sequence[Path],
    noisy: Sequence[Path],
    labels: Sequence[str],
    parameters: Parameterisation,
    png: Path,
    csv: Path,
) -> None:
    """Draw boxes (quartiles) with whiskers (5 and 95 %) of the HPD widths of all cases.

    recoveries, noisy: `recovery.csv` of the sets `labels` and of their noisy twins. The
    table: noise, set, parameters (which), then STATISTICS.
    """
    rows, warnings = [], []
    fig = style.figure(11.0, 4.8)
    axes = scenarios.panels(fig, 1, 2, sharey=True)[0]
    for ax, noise, paths in zip(axes, scenarios.NOISE, (recoveries, noisy), strict=True):
        table = scenarios.read_sets(paths, labels, parameters)
        warnings.append(scenarios.warning(table))
        rows += _boxes(ax, table, labels, noise)
        ax.set_title(noise)
    axes[0].set(ylabel="width of the 95 % HPD interval", yscale="log")
    for ax in axes:
        ax.yaxis.grid(True, which="both", color=style.LIGHT, linewidth=0.5)
    handles = [Patch(color=colour, label=name) for name, colour in GROUPS.items()]
    fig.legend(handles=handles, loc="outside lower center", ncols=3)
    style.suptitle(
        fig,
        f"How well single parameters are known (the prior's width: {_prior_width(parameters)})",
        " / ".join(filter(None, warnings)),
    )
    style.save(fig, pd.DataFrame(rows), png, csv)


def _prior_width(parameters: Parameterisation) -> str:
    """Width of the prior's own 95 % interval, by factor where they differ."""
    widths = {name: f"{0.95 * np.ptp(bounds):.2f}" for name, bounds in parameters.bounds.items()}
    if len(set(widths.values())) == 1:
        return next(iter(widths.values()))
    return ", ".join(f"{style.factor_label(name)} {width}" for name, width in widths.items())


def _boxes(ax, table: pd.DataFrame, labels: Sequence[str], noise: str) -> list[dict]:
    rows = []
    for at, label in enumerate(labels):
        mine = table[table["set"] == label]
        split = dict(zip(GROUPS, (mine, mine[mine["stiffened"]], mine[~mine["stiffened"]]),
                         strict=True))  # fmt: skip
        for shift, (group, part) in zip((-0.26, 0, 0.26), split.items(), strict=True):
            if part.empty:
                continue
            width = part["hpd_width95"]
            quantiles = width.quantile([0.05, 0.25, 0.5, 0.75, 0.95]).to_numpy()
            values = (part["case"].nunique(), *quantiles, width.mean())
            rows.append(
                {"noise": noise, "set": label, "parameters": group}
                | dict(zip(STATISTICS, values, strict=True))
            )
            low, first, middle, third, high = quantiles
            box = {"whislo": low, "q1": first, "med": middle, "q3": third, "whishi": high}
            ax.bxp(
                [box],
                positions=[at + shift],
                widths=0.22,
                showfliers=False,
                patch_artist=True,
                manage_ticks=False,
                boxprops={"facecolor": GROUPS[group], "alpha": 0.6, "linewidth": 0.8},
                medianprops={"color": style.BLACK},
            )
    ax.set_xticks(range(len(labels)), labels)
    return rows
