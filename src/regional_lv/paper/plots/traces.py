"""Chains, marginal posteriors and autocorrelation (the paper's Figure S6)."""

from pathlib import Path

import numpy as np
import pandas as pd
import seaborn

from regional_lv.emulators.gaussian import Z95
from regional_lv.inference.arviz_arrays import autocorr
from regional_lv.paper.case_posterior import read
from regional_lv.plots import style
from regional_lv.plots.density import density

MAX_LAG = 40


@style.context
def draw(
    posterior: Path,
    diagnostics: Path,
    source: str,
    png: Path,
    csv: Path,
    truth: Path | None = None,
    case: str | None = None,
) -> None:
    """Draw every parameter and noise scale of one case: trace, marginal, autocorrelation.

    posterior: NetCDF; diagnostics: its verdict; source: `subjects.<name>.source` of the config;
    truth: JSON of a synthetic subject; case: needed if `posterior` holds several. The truth is
    dashed green, the 95 % HPD interval dotted vermillion. The table is long: parameter, item (draw,
    density, autocorrelation, median, lower95, upper95, truth), chain, x (draw, value or lag), y.
    """
    found = read(posterior, diagnostics, case=case, truth=truth)
    summary = found.summary()
    names = list(found.draws)
    fig = style.figure(10.5, 1.15 * len(names) + 1.2)
    axes = fig.subplots(len(names), 3, width_ratios=[2.4, 0.8, 1.2], squeeze=False)
    _share(axes)
    rows: list[tuple] = []
    for (trace, marginal, memory), name in zip(axes, names, strict=True):
        draws = found.draws[name]
        row = summary.loc[name]
        trace_panel(trace, name, draws, rows)
        marginal_panel(marginal, trace, name, draws, rows)
        _autocorrelation(memory, name, draws, rows)
        for item in summary.columns:
            rows.append((name, item, None, row[item], None))
        if name in found.truth:
            rows.append((name, "truth", None, found.truth[name], None))
        mark(trace, marginal, row, found.truth.get(name))
    titles = {"Trace": "draw", "Posterior": "", "Autocorrelation": "lag"}
    for (title, label), column in zip(titles.items(), axes.T, strict=True):
        column[0].set_title(title)
        column[-1].set_xlabel(label)
    fig.align_ylabels(axes[:, 0])
    legend(fig, axes[0, 0], len(draws), bool(found.truth))
    style.suptitle(
        fig,
        found.title(f"Convergence check {found.verdict.split(':')[0]}", source),
        found.warning,
    )
    table = pd.DataFrame(rows, columns=["parameter", "item", "chain", "x", "y"])
    table.insert(0, "case", found.case)
    table["verdict"] = found.verdict
    style.save(fig, table, png, csv)


def _share(axes: np.ndarray) -> None:
    """One axis of draws, and one of lags."""
    for column in axes.T[[0, 2]]:
        for ax in column[1:]:
            ax.sharex(column[0])
        for ax in column[:-1]:
            ax.tick_params(labelbottom=False)


def _lines(ax, values: np.ndarray, **options) -> None:
    """A line for each row of `values` (chain, x), in the colour of its chain."""
    long = pd.DataFrame(values.T).melt(ignore_index=False, var_name="chain").reset_index()
    seaborn.lineplot(
        long,
        x="index",
        y="value",
        hue="chain",
        palette=chain_colours(len(values)),
        ax=ax,
        estimator=None,
        legend=False,
        **options,
    )
    ax.set(xlabel="", ylabel="")


def chain_colours(chains: int) -> list[str]:
    """Colour of each chain."""
    return [style.CHAIN_COLOURS[chain % len(style.CHAIN_COLOURS)] for chain in range(chains)]


def trace_panel(ax, name: str, draws: np.ndarray, rows: list) -> None:
    """Draw the chains of one parameter into `ax`; append what is drawn to `rows`."""
    _lines(ax, draws, linewidth=0.5, alpha=0.8)
    rows += [(name, "draw", *at, value) for at, value in np.ndenumerate(draws)]
    ax.set_ylabel(style.in_lines(style.label(name)), rotation=0, ha="right", va="center")
    ax.margins(x=0.01)


def marginal_panel(ax, trace, name: str, draws: np.ndarray, rows: list) -> None:
    """Draw histogram and density of one parameter into `ax`, beside its `trace`, with whose axis of
    values; append the density to `rows`.

    The density is ArviZ's, which holds at the prior's bounds, where that of seaborn would fall.
    """
    seaborn.histplot(
        y=draws.ravel(), bins=40, stat="density", color=style.LIGHT, alpha=1, linewidth=0, ax=ax
    )
    values, heights = density(draws)
    seaborn.lineplot(x=heights, y=values, orient="y", color=style.BLUE, ax=ax)
    rows += [(name, "density", None, v, h) for v, h in zip(values, heights, strict=True)]
    ax.sharey(trace)
    ax.tick_params(labelleft=False, length=0)
    ax.set(xticks=[], xlabel="", ylabel="")
    ax.spines["bottom"].set_visible(False)


def _autocorrelation(ax, name: str, draws: np.ndarray, rows: list) -> None:
    lags = min(MAX_LAG, draws.shape[1] - 1)
    # About zero, 95 % of an uncorrelated sequence of this length.
    ax.axhspan(*(np.array([-1, 1]) * Z95 / np.sqrt(draws.shape[1])), color=style.LIGHT, zorder=0)
    correlations = autocorr(draws)[:, : lags + 1]
    _lines(ax, correlations, linewidth=1)
    rows += [(name, "autocorrelation", *at, value) for at, value in np.ndenumerate(correlations)]
    ax.set(ylim=(-0.35, 1.05), yticks=[0, 1])


def mark(trace, marginal, row: pd.Series, truth: float | None) -> None:
    """Draw median and 95 % HPD interval of `row`, and the truth if it is known."""
    marginal.axhline(row["median"], color=style.BLACK, linewidth=0.9)
    for ax in (trace, marginal):
        for limit in (row["lower95"], row["upper95"]):
            ax.axhline(limit, color=style.VERMILLION, linestyle=":", linewidth=1.2)
        if truth is not None:
            ax.axhline(truth, color=style.GREEN, linestyle="--", linewidth=1.4, zorder=4)


def legend(fig, ax, chains: int, has_truth: bool) -> None:
    """Name chains, interval and truth below the figure; `ax` lends its handles."""
    for chain, colour in enumerate(chain_colours(chains)):
        ax.plot([], [], color=colour, label=f"chain {chain + 1}")
    ax.plot([], [], color=style.BLACK, linewidth=0.9, label="median")
    ax.plot([], [], ":", color=style.VERMILLION, label="95 % HPD interval")
    if has_truth:
        ax.plot([], [], "--", color=style.GREEN, label="truth")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=chains + 3)
