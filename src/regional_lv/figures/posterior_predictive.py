"""What the posterior predicts for each output, against the observations (the paper's Figure 12)."""

from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.errors import InputError
from regional_lv.figures import style
from regional_lv.figures.posterior import density, read

VIOLIN_COLOURS = {
    "circumferential": style.SKY,
    "radial": style.GREEN,
    "longitudinal": style.ORANGE,
    "volume": style.PINK,
}


@style.context
def draw(nc: Path, diagnostics: Path, source: str, png: Path, csv: Path) -> None:
    """Draw violins of the posterior predictive and the observations on them.

    nc: one subject's InferenceData with `posterior_predictive` (output error and measurement noise
    included, natural units) and `constant_data.y_obs`. Strain is read on the left, volume on the
    right. The table is long: output, quantity, segment, item (observed, median, lower95, upper95,
    density), value, density, inside.
    Raises InputError if the file has no posterior predictive.
    """
    posterior = read(nc, diagnostics)
    data = az.from_netcdf(nc)
    if "posterior_predictive" not in data.groups():
        raise InputError(f"{nc}: no group `posterior_predictive`; rerun the subject's inference")
    predicted = data.posterior_predictive["y"].sel(case=posterior.case)
    observed = data.constant_data["y_obs"].sel(case=posterior.case)
    observed = observed.to_series().reindex(list(aha.OUTPUTS))
    present = set(predicted["output"].values.tolist())
    groups = {
        q: [o for o in aha.OUTPUTS if style.quantity_of(o) == q and o in present]
        for q in (*aha.DIRECTIONS, "volume")
    }
    groups = {q: names for q, names in groups.items() if names}

    count = sum(map(len, groups.values()))
    fig = style.figure(max(6.0, 0.27 * count + 2.5), 5.0)
    ax = fig.subplots()
    right = ax.twinx() if "volume" in groups else None
    rows, ticks, at = [], {}, 0.0
    for quantity, names in groups.items():
        axis = right if quantity == "volume" else ax
        start = at
        for name in names:
            rows += _violin(axis, at, name, quantity, predicted.sel(output=name), observed[name])
            ticks[at] = str(style.segment_of(name) or "V")
            at += 1.0
        ax.text(
            (start + at - 1) / 2,
            1.01,
            quantity,
            transform=ax.get_xaxis_transform(),
            ha="center",
            va="bottom",
            color=style.BLACK,
        )
        at += 1.2
    if right is not None:
        right.spines["right"].set_visible(True)
        right.set_ylabel("volume (mL)")
        right.set_ylim(_padded(rows, "volume"))
        ax.axvline(at - 1.2 - 1.0 - 1.1, color=style.LIGHT, linewidth=0.8)
    ax.axhline(0, color=style.LIGHT, linewidth=0.8, zorder=0)
    ax.set_xticks(list(ticks), list(ticks.values()))
    ax.set(xlim=(-1, at - 0.2), xlabel="AHA segment (V: volume)", ylabel="strain")

    table = pd.DataFrame(
        rows, columns=["output", "quantity", "segment", "item", "value", "density", "inside"]
    )
    table.insert(0, "subject", posterior.case)
    table["verdict"] = posterior.verdict
    seen = table[table["item"] == "observed"]
    outside = int((~seen["inside"].astype(bool)).sum())
    ax.plot(
        [], [], "D", color=style.OBSERVED, markersize=5, label="observed, inside the 95 % interval"
    )
    ax.plot([], [], "x", color=style.OBSERVED, markersize=7, mew=2, label="observed, outside")
    fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    title = posterior.title("Posterior predictive", source)
    style.suptitle(
        fig, f"{title}: {outside} of {len(seen)} observations outside", posterior.warning
    )
    style.save(fig, table, png, csv)


def _violin(ax, at: float, name: str, quantity: str, draws, observed: float) -> list[tuple]:
    draws = np.ravel(draws)
    lower, median, upper = np.quantile(draws, [0.025, 0.5, 0.975])
    values, heights = density(draws)
    width = 0.42 * heights / heights.max()
    colour = VIOLIN_COLOURS[quantity]
    ax.fill_betweenx(values, at - width, at + width, color=colour, alpha=0.55, linewidth=0.6)
    ax.plot([at, at], [lower, upper], color=style.BLACK, linewidth=0.8)
    ax.plot([at - 0.16, at + 0.16], [median, median], color=style.BLACK, linewidth=1.2)
    inside = bool(lower <= observed <= upper)
    head = (name, quantity, style.segment_of(name))
    rows = [
        (*head, item, value, np.nan, None)
        for item, value in (("median", median), ("lower95", lower), ("upper95", upper))
    ]
    rows += [(*head, "density", v, h, None) for v, h in zip(values, heights, strict=True)]
    if np.isfinite(observed):
        shape = {"marker": "D", "markersize": 4} if inside else {"marker": "x", "markersize": 7}
        ax.plot(at, observed, color=style.OBSERVED, mew=1 if inside else 2, zorder=5, **shape)
        rows.append((*head, "observed", float(observed), np.nan, inside))
    return rows


def _padded(rows: list[tuple], quantity: str) -> tuple[float, float]:
    """Limits that leave the volume's violin the middle third: its own axis needs no more."""
    values = [row[4] for row in rows if row[1] == quantity]
    low, high = min(values), max(values)
    return low - (high - low), high + (high - low)
