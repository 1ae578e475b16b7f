"""Rank histograms of simulation-based calibration: flat if posteriors mean what they say."""

from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from scipy import stats

from regional_lv.emulators import label_of
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors.files import chosen
from regional_lv.plots import style

BAND = 0.99
TESTS = {"p_chi2": r"$\chi^2$", "p_ecdf": "ECDF"}


@style.context
def draw(
    ranks: Path, tests: Path, choice: Path, parameters: StiffnessInputs, png: Path, csv: Path
) -> None:
    """Draw the rank of the truth among the draws, per parameter and over all.

    ranks: `sbc.csv` (parameter, draws, cases, bin, lower_rank, upper_rank, count, expected);
    tests: `sbc_test.csv` (parameter, chi2, p_chi2, p_ecdf, p_holm, passed, ...); choice: JSON with
    the name of the `final` emulator, whose chain this is. The grey band
    holds 99 % of the counts of one bin if the chain is right; over all parameters, which share
    cases, it is drawn as for independent counts and therefore too narrow. The table: `ranks` with
    the band and each parameter's tests.
    """
    table = pd.read_csv(ranks)
    checks = pd.read_csv(tests).set_index("parameter")
    total = table.groupby("parameter")["count"].transform("sum")
    share = table["expected"] / total
    for name, level in (("band_lower", (1 - BAND) / 2), ("band_upper", (1 + BAND) / 2)):
        table[name] = stats.binom.ppf(level, total, share)
    factors, zones = parameters.factors, len(parameters.zones)
    # The panel of all parameters comes after those of the last zone.
    (rows, columns), _ = style.zone_places(zones + 1, len(factors))
    fig = style.figure(2.0 * columns if columns > 3 else 3.0 * columns, 3.3 * rows)
    axes = style.zone_panels(fig, zones + 1, len(factors), sharex=True)
    places = dict(zip(parameters.names, axes[:, :zones].T.ravel(), strict=True))
    places["all"] = axes[0, zones]
    for ax in axes[1:, zones]:
        ax.set_axis_off()
    for name, ax in places.items():
        _panel(ax, table[table["parameter"] == name], checks.loc[name])
    for ax in axes[:, :: style.ZONES_PER_ROW].ravel():
        ax.set_ylabel("cases")
    for ax in (*axes[-1, :zones], places["all"]):
        ax.set_xlabel("rank of the truth (%)", visible=True)
        ax.tick_params(labelbottom=True)
    fig.legend(*places["all"].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    failed = [style.label(name) for name in parameters.names if not checks.loc[name, "passed"]]
    warning = "CALIBRATION REJECTED: " + ", ".join(failed) if failed else ""
    cases = int(table["cases"].max())
    emulator = label_of(chosen(choice))
    style.suptitle(
        fig, f"Simulation-based calibration of the chain, {emulator}, {cases} prior draws", warning
    )
    style.save(
        fig,
        table.merge(checks.add_prefix("test_"), left_on="parameter", right_index=True),
        png,
        csv,
    )


def _panel(ax, part: pd.DataFrame, check: pd.Series) -> None:
    part = part.sort_values("bin")
    ends = part["upper_rank"].max() + 1
    edges = np.append(100 * part["lower_rank"] / ends, 100.0)
    seaborn.histplot(
        x=edges[:-1],
        weights=part["count"],
        bins=[*edges],
        ax=ax,
        color=style.SKY,
        alpha=1,
        edgecolor="white",
        linewidth=1,
    )
    band = f"{100 * BAND:g} % of counts if the chain is right"
    for name, line, label in (
        ("band_lower", "-", band),
        ("expected", "--", "expected count"),
        ("band_upper", "-", None),
    ):
        ax.stairs(part[name], edges, color=style.GREY, linestyle=line, baseline=None, label=label)
    ax.set(xticks=[0, 50, 100], ylabel="")
    found = [f"{check[key]:.2g} ({test})" for key, test in TESTS.items() if np.isfinite(check[key])]
    title = style.label(check.name)
    ax.set_title("\n".join([title, "p = " + ", ".join(found) if found else ""]), fontsize=9)
