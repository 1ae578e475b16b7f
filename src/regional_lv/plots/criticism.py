"""What a criticism found, drawn from its findings: residuals, causes, parameters, stiffness."""

import textwrap
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.colors import Normalize
from matplotlib.patches import Patch

from regional_lv import aha
from regional_lv.criticism import words
from regional_lv.criticism.contract import Findings
from regional_lv.parameters import Parameterisation
from regional_lv.plots import bullseye, style

SHOWN_Z = 4.0
"""z at which the residuals' colours saturate."""

SHOWN_CAUSES = 4
"""Posteriors of psi that are drawn."""

WHEN = {"before": "the model as it is", "after": "with the best set of causes"}


@style.context
def draw_residuals(
    findings: Findings, png: Path, csv: Path, parameters: Parameterisation | None = None
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
    """All causes: score against the base model on the left, probability over all sets of causes on
    the right. p-values at the smallest that the bootstrap can give are marked with "<=".
    """
    table = pd.DataFrame(
        [
            {
                "cause": words.cause(h["name"], h["component"]),
                **{
                    k: h[k]
                    for k in (
                        *("name", "component", "z", "p_value", "p_value_single", "probability"),
                        *("identifiable", "absorbed", "fitted", "fraction_simulated"),
                    )
                },
            }
            for h in findings["hypotheses"]
        ]
    )
    table["size"] = table["z"].abs()
    table = table.sort_values(["probability", "identifiable", "size"], ascending=False)
    fig = style.figure(8.4, 0.27 * len(table) + 1.7)
    left, right = fig.subplots(1, 2, sharey=True, width_ratios=[3, 2])
    at = np.arange(len(table))[::-1]
    grouped = {name for group in findings["groups"] for name in group}
    kinds = {"named": style.VERMILLION, "one of a group": style.ORANGE, "not named": style.BLUE}
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
def draw_parameters(findings: Findings, png: Path, csv: Path) -> bool:
    """Posterior densities of the parameters of the most probable causes that were sampled.

    Returns whether there was anything to draw.
    """
    likely = sorted(findings["hypotheses"], key=lambda h: -h["probability"])
    fitted = [(h, h["posterior"]) for h in likely if h["posterior"]][:SHOWN_CAUSES]
    if not fitted:
        return False
    fig = style.figure(max(2.6 * len(fitted) + 0.4, 6.0), 3.1)
    axes = fig.subplots(1, len(fitted), squeeze=False)[0]
    rows, labels = [], {}
    for ax, (h, posterior) in zip(axes, fitted, strict=True):
        edges, density = np.array(posterior["edges"]), np.array(posterior["density"])
        ax.stairs(density, edges, fill=True, color=style.SKY)
        for bound in h["interval95"]:
            labels["95 % interval"] = ax.axvline(
                bound, color=style.BLUE, linewidth=0.8, linestyle=":"
            )
        near = 0.5 * (edges[-1] - edges[0])
        if edges[0] - near <= h["base"] <= edges[-1] + near:
            labels["assumed by the model"] = ax.axvline(h["base"], color=style.VERMILLION)
        for end in h["range"]:
            if edges[0] - near / 5 <= end <= edges[-1] + near / 5:
                labels["end of the plausible range"] = ax.axvline(
                    end, color=style.BLACK, linewidth=2.5
                )
        unit = "" if h["unit"] == "1" else f" ({h['unit']})"
        title = words.cause(h["name"], h["component"])
        title += ", at the end of its range" if h["at_bound"] else ""
        ax.set_title(textwrap.fill(title, 28), fontsize=8.5)
        ax.set_xlabel(textwrap.fill(f"{h['parameter']}{unit}", 28))
        ax.set_yticks([])
        centres = (edges[1:] + edges[:-1]) / 2
        rows += [(h["name"], h["component"], *pair) for pair in zip(centres, density, strict=True)]
    axes[0].set_ylabel("posterior density")
    fig.legend(labels.values(), labels.keys(), loc="outside lower center", ncols=len(labels))
    table = pd.DataFrame(rows, columns=["name", "component", "value", "density"])
    style.save(fig, table, png, csv)
    return True


@style.context
def draw_theta(findings: Findings, png: Path, csv: Path) -> None:
    """Stiffness factors before and after: posterior mean and two standard deviations."""
    table = pd.DataFrame(
        [
            {
                "parameter": row["parameter"],
                "mean_before": row["before"][0],
                "sd_before": row["before"][1],
                "mean_after": row["after"][0],
                "sd_after": row["after"][1],
                "shift_sd": row["shift_sd"],
            }
            for row in findings["theta"]
        ]
    )
    fig = style.figure(max(5.0, 0.6 * len(table) + 1.5), 3.2)
    ax = fig.subplots()
    whens = ("before",) if findings["remaining"] is None else ("before", "after")
    shown = []
    for when in whens:
        mean, sd = table[f"mean_{when}"], table[f"sd_{when}"]
        ends = {"lower": (mean - 2 * sd).clip(lower=0), "upper": mean + 2 * sd}
        shown.append(table[["parameter"]].assign(when=WHEN[when], mean=mean, **ends))
    style.intervals(
        ax,
        pd.concat(shown),
        "parameter",
        "mean",
        ("lower", "upper"),
        hue="when",
        palette=dict(zip(WHEN.values(), (style.GREY, style.VERMILLION), strict=True)),
        dodge=0.24,
    )
    ax.axhline(1, color=style.LIGHT, zorder=0)
    labels = [style.label(p) for p in table["parameter"]]
    ax.set_xticks(range(len(table)), labels, rotation=45, ha="right")
    ax.set(xlabel="", ylabel="stiffness factor\n(posterior mean ± 2 sd)")
    ax.legend(title="", loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    style.save(fig, table, png, csv)
