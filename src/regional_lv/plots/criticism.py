"""What a criticism found, drawn from its findings: residuals, causes, their effects, and sources of
the uncertainty."""

import textwrap
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.colors import Normalize
from matplotlib.patches import Patch

from regional_lv import aha
from regional_lv.criticism import words
from regional_lv.criticism.contract import Findings, read_findings
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.plots import bullseye, style

SHOWN_Z = 4.0
"""z at which the residuals' colours saturate."""

SHOWN_CAUSES = 4
"""Posteriors of effects that are drawn."""

WRITTEN = 7.0
"""Per cent of a variance from which on they are written into their bar."""

WHEN = {"before": "the model as it is", "after": "with the best set of causes"}


def draw(
    findings: Path,
    parameters: StiffnessInputs,
    residuals: Path,
    causes: Path,
    effects: Path,
    sources: Path,
    tables: Sequence[Path],
) -> None:
    """Draw all figures of a criticism.

    findings: JSON. residuals, causes, effects, sources: figures (PNG); tables: their data (CSV), in
    this order. parameters: whose zones are outlined.
    """
    content = read_findings(findings)
    one, two, three, four = tables
    draw_residuals(content, residuals, one, parameters)
    draw_causes(content, causes, two)
    draw_effects(content, effects, three)
    draw_sources(content, sources, four)


@style.context
def draw_residuals(
    findings: Findings, png: Path, csv: Path, parameters: StiffnessInputs | None = None
) -> None:
    """Bullseyes of the leave-one-segment-out residuals, before and after what was found.

    z = (observed - predicted from all other segments) / sd; of several hearts, the mean. What
    belongs to no segment is written below. Of several loads the largest is drawn. parameters: whose
    zones are outlined, if given. The table, of all loads: when, output, quantity, segment,
    load_fraction, z, observed, predicted, sd (subject by subject).
    """
    steps = {"before": findings["misfit"]}
    if findings["remaining"] is not None:
        steps["after"] = findings["remaining"]
    tables = {when: pd.DataFrame(step["channels"]) for when, step in steps.items()}
    whole = tables["before"]["segment"].isna()
    directions = list(dict.fromkeys(tables["before"].loc[~whole, "quantity"]))
    columns = max(len(directions), 1)  # without any strain, there is only what stands below
    fig = style.figure(2.9 * columns + 0.9, (3.35 if directions else 1.2) * len(steps) + 0.3)
    axes = fig.subplots(len(steps), columns, squeeze=False)
    for row, (when, all_loads) in zip(axes, tables.items(), strict=True):
        table = all_loads[all_loads["load_fraction"] == all_loads["load_fraction"].max()]
        for ax, direction in zip(row[: len(directions)], directions, strict=True):
            z = table[table["quantity"] == direction].groupby("segment")["z"].mean()
            values = z.reindex([s.number for s in aha.SEGMENTS]).to_numpy(float)
            labels = [f"{v:+z.1f}" if np.isfinite(v) else "" for v in values]
            norm = Normalize(-SHOWN_Z, SHOWN_Z)
            with matplotlib.rc_context({"font.size": 7.5}):
                scale = bullseye.paint_values(ax, values, norm, "RdBu_r", labels, parameters)
            ax.set_title(f"{direction}\n{WHEN[when]}")
        means = table[table["segment"].isna()].groupby("quantity", sort=False)["z"].mean()
        text = "\n".join(f"{quantity}: {z:+z.1f} sd" for quantity, z in means.items())
        if directions:
            row[0].text(-1.0, -1.12, text, va="top", fontsize=8)
        else:
            row[0].set_axis_off()
            row[0].set_title(f"{WHEN[when]}: observed - predicted", fontsize=9)
            row[0].text(0.5, 0.8, text, va="top", ha="center", fontsize=9)
    if directions:
        bar = fig.colorbar(scale, ax=axes, shrink=0.6, extend="both")
        bar.set_label("observed - predicted (sd of the prediction)")
    table = pd.concat([t.assign(when=when) for when, t in tables.items()])
    style.save(fig, table, png, csv)


@style.context
def draw_causes(findings: Findings, png: Path, csv: Path) -> None:
    """All causes: score against the model as it is on the left, probability over all models on the
    right. p-values at the smallest that the bootstrap can give are marked with "<=".
    """
    table = pd.DataFrame(
        [
            {
                "cause": words.cause(cause["name"], cause["component"]),
                **{
                    k: cause[k]
                    for k in (
                        "name",
                        "component",
                        "z",
                        "p_value",
                        "p_value_single",
                        "probability",
                        "identifiable",
                        "absorbed",
                        "estimate",
                        "at_bound",
                    )
                },
                **dict(zip(("lower95", "upper95"), cause["interval95"], strict=True)),
            }
            for cause in findings["hypotheses"]
        ]
    )
    if table.empty:
        _draw_nothing("no cause was searched", png, csv)
        return
    table["size"] = table["z"].abs()
    table = table.sort_values(["probability", "identifiable", "size"], ascending=False)
    fig = style.figure(8.4, 0.27 * len(table) + 1.7)
    left, right = fig.subplots(1, 2, sharey=True, width_ratios=[3, 2])
    at = np.arange(len(table))[::-1]
    grouped = {name for group in findings["groups"] for name in group}
    kinds = {
        words.certainty(findings).lower(): style.VERMILLION,
        "one of a group": style.ORANGE,
        "not named": style.BLUE,
    }
    kinds["not identifiable"] = style.LIGHT
    table["kind"] = np.select(
        [table["name"].isin(findings["named"]), table["name"].isin(grouped), table["identifiable"]],
        list(kinds)[:3],
        "not identifiable",
    )
    colours = table["kind"].map(kinds)
    lengths = np.where(table["identifiable"], table["size"], 0.0)
    left.barh(at, lengths, color=colours, height=0.65)
    for y, length, (_, row) in zip(at, lengths, table.iterrows(), strict=True):
        text = "not identifiable"
        if row["identifiable"]:
            least = row["p_value"] <= findings["least_p_value"] * (1 + 1e-9)
            p = f"p ≤ {row['p_value']:.2g}" if least else words.p_value(row["p_value"])
            text = f"{row['z']:+z.1f} ({p})"
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}  # over the dashed line
        at_end = {"xytext": (5, 0), "textcoords": "offset points", "va": "center"}
        left.annotate(text, (length, y), **at_end, fontsize=7.5, bbox=box)
    left.axvline(findings["critical_z"] or 0, color=style.BLACK, linestyle="--", linewidth=0.8)
    left.set_yticks(at, table["cause"])
    left.set_xlim(0, 1.4 * max(lengths.max(), 4.0))
    left.set_xlabel(
        "score z against the model as it is\n(dashed: significant at "
        f"{100 * findings['level']:g} % over the catalogue)"
    )
    right.barh(at, table["probability"], color=colours, height=0.65)
    least = findings["least_probability"]
    right.axvline(least, color=style.BLACK, linestyle="--", linewidth=0.8)
    right.set_xlim(0, 1.02)
    right.set_xlabel(f"probability over all sets\n(dashed: {least:g})")
    handles = [Patch(color=c, label=k) for k, c in kinds.items() if k in set(table["kind"])]
    fig.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    style.save(fig, table.drop(columns=["size", "kind"]), png, csv)


@style.context
def draw_effects(findings: Findings, png: Path, csv: Path) -> None:
    """Posterior densities of the parameters of the most probable causes, given that they are
    present."""
    likely = sorted(findings["hypotheses"], key=lambda cause: -cause["probability"])
    fitted = [(cause, cause["posterior"]) for cause in likely if cause["posterior"]][:SHOWN_CAUSES]
    if not fitted:
        _draw_nothing("no model with a cause was sampled", png, csv)
        return
    fig = style.figure(max(2.6 * len(fitted) + 0.4, 6.0), 3.1)
    axes = fig.subplots(1, len(fitted), squeeze=False)[0]
    rows, labels = [], {}
    for ax, (cause, posterior) in zip(axes, fitted, strict=True):
        edges, density = np.array(posterior["edges"]), np.array(posterior["density"])
        ax.stairs(density, edges, fill=True, color=style.SKY)
        for bound in cause["interval95"]:
            labels["95 % interval"] = ax.axvline(
                bound, color=style.BLUE, linewidth=0.8, linestyle=":"
            )
        near = 0.5 * (edges[-1] - edges[0])
        if edges[0] - near <= cause["base"] <= edges[-1] + near:
            labels["assumed by the model"] = ax.axvline(
                cause["base"], color=style.VERMILLION, zorder=3
            )
        for end in cause["range"]:
            if edges[0] - near / 5 <= end <= edges[-1] + near / 5:
                labels["end of the plausible range"] = ax.axvline(
                    end, color=style.BLACK, linewidth=2.5
                )
        unit = "" if cause["unit"] == "1" else f" ({cause['unit']})"
        title = words.cause(cause["name"], cause["component"])
        title += ", at the end of its range" if cause["at_bound"] else ""
        ax.set_title(textwrap.fill(title, 28), fontsize=8.5)
        ax.set_xlabel(textwrap.fill(f"{cause['parameter']}{unit}", 28))
        ax.set_yticks([])
        centres = (edges[1:] + edges[:-1]) / 2
        rows += [
            (cause["name"], cause["component"], *pair)
            for pair in zip(centres, density, strict=True)
        ]
    axes[0].set_ylabel("posterior density")
    fig.legend(labels.values(), labels.keys(), loc="outside lower center", ncols=len(labels))
    table = pd.DataFrame(rows, columns=["name", "component", "value", "density"])
    style.save(fig, table, png, csv)


@style.context
def draw_sources(findings: Findings, png: Path, csv: Path) -> None:
    """What the variance of each stiffness factor comes from, as shares; measured inputs by their
    kind. The table: parameter, source, share."""
    shares = [
        (row["name"], words.variance_source(source), share)
        for row in findings["stiffness"]
        for source, share in row["sources"].items()
    ]
    table = pd.DataFrame(shares, columns=["parameter", "source", "share"])
    if table.empty:
        _draw_nothing("no stiffness is inferred", png, csv)
        return
    wide = table.pivot_table(
        index="parameter", columns="source", values="share", aggfunc="sum", sort=False
    ).fillna(0.0)
    # What doubt about the model adds stands last, whatever was measured.
    last = words.variance_source("models")
    wide = wide[[*(c for c in wide if c != last), *([last] if last in wide else [])]]
    fig = style.figure(7.6, 0.3 * len(wide) + 1.3)
    ax = fig.subplots()
    at, start = np.arange(len(wide))[::-1], np.zeros(len(wide))
    palette = cycle((style.SKY, style.GREEN, style.ORANGE, style.PINK, style.LIGHT, style.GREY))
    for source, shares_of in wide.items():
        percent = 100 * shares_of.to_numpy()
        colour = style.VERMILLION if source == last else next(palette)
        ax.barh(at, percent, left=start, color=colour, height=0.7, label=source)
        for y, left, value in zip(at, start, percent, strict=True):
            if value >= WRITTEN:
                ax.text(left + value / 2, y, f"{value:.0f}", ha="center", va="center")
        start = start + percent
    ax.set_yticks(at, [style.label(name) for name in wide.index])
    ax.set(xlim=(0, 100), xlabel="share of the variance of the logarithm (%)")
    fig.legend(loc="outside upper center", ncols=min(len(wide.columns), 6))
    written = wide.rename_axis(columns="source").stack().rename("share").reset_index()
    style.save(fig, written, png, csv)


def _draw_nothing(why: str, png: Path, csv: Path) -> None:
    """A figure that says why there is none, and an empty table."""
    fig = style.figure(5.0, 1.0)
    ax = fig.subplots()
    ax.set_axis_off()
    ax.text(0.5, 0.5, why, ha="center", va="center")
    style.save(fig, pd.DataFrame(columns=["why"]), png, csv)
