"""One HTML page for each subject, that needs nothing but itself."""

import base64
import json
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path

import jinja2
import numpy as np
import pandas as pd
from markupsafe import Markup
from plotly.offline import get_plotlyjs
from scipy import stats

from regional_lv import aha
from regional_lv.channels import Channel, Channels
from regional_lv.criticism import words
from regional_lv.criticism.case_posterior import SOURCES, AveragedPosterior, read_averaged
from regional_lv.criticism.contract import Findings, MeasuredInput, read_findings
from regional_lv.emulators import label_of
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured import read_measured
from regional_lv.mechanics.materials import MATERIALS
from regional_lv.page import heart3d
from regional_lv.plots import style
from regional_lv.quantities import seth_hill

TEMPLATE = Path(__file__).parent / "page.html"
SEVERAL = Path(__file__).parent / "several.html"

SAME_AS_PRIOR = 0.1
"""Largest distance between the distribution functions of posterior and prior (Kolmogorov-Smirnov)
at which the data are reported not to constrain a parameter."""

STRONG = 0.7
"""Correlation of the logarithms of a zone's factors from which on a trade-off is reported."""

MOVED = 1.0
"""Posterior standard deviations from which on a change of a factor is shown in bold."""


FAMILIES = {
    "overall": "all residuals together",
    "channel": "single channels",
    "direction": "strain directions",
    "level": "levels, direction by direction",
    "wall": "walls, direction by direction",
    "cause": "listed causes",
    "pair": "pairs of listed causes",
}
"""Tests of the misfit by the name of their family."""

SHOWN_INPUTS = 6
"""Measured inputs that the page lists at once, those that the data moved most."""


def make_page(
    subject: str,
    study: str,
    source: str,
    measured: str | Path,
    posterior: str | Path,
    findings: str | Path,
    emulator: str,
    strains_picture: str | Path,
    stiffness_picture: str | Path,
    fit_picture: str | Path,
    residuals_picture: str | Path,
    causes_picture: str | Path,
    effects_picture: str | Path,
    sources_picture: str | Path,
    parameters: StiffnessInputs,
    channels: Channels,
    pressure_mmhg: float,
    strain_exponent: float,
    scales_with_pressure: bool,
    page: str | Path,
    limitations: str = "",
    notes: Sequence[str] = (),
    extended: str = "",
    predictions: str | Path | None = None,
    choice: str | Path | None = None,
    mesh: str | Path | None = None,
    zones_picture: str | Path | None = None,
    template: str | Path = TEMPLATE,
) -> None:
    """Write the page of one subject.

    Parameters
    ----------
    source: `subjects.<name>.source` of the config.
    measured: its measured table; posterior, findings: averaged over models (NetCDF), and what the
        criticism found (JSON).
    emulator: its name, or `final`; predictions: what it predicts of the test set (Parquet), if it
        has one.
    choice: how it was chosen (JSON), if it was.
    strains_picture, stiffness_picture, fit_picture: figures (PNG) of `plots.measured_strains`,
        `plots.bullseye_posterior` and `plots.posterior_predictive`; residuals_picture,
        causes_picture, effects_picture, sources_picture: of `plots.criticism`.
    channels: what the study observes.
    pressure_mmhg, strain_exponent: the study's end-diastolic pressure and strain measure.
    scales_with_pressure: whether stresses of the study scale with theta and pressure alone.
    limitations: where the page finds the project's limitations, if it does. notes: what else the
        answer rests on, sentences without a full stop. extended: the file that the study
        with the named causes goes to, if it can be made.
    mesh, zones_picture: the unloaded heart (VTU) and the figure of its zones (PNG), if the study
        has one.
    """
    table = read_measured(measured, strain_exponent=None)
    content, drawn = read_findings(findings), read_averaged(posterior, findings)
    rows = stiffness_of(drawn, parameters)
    means = {row["name"]: row["mean"] for row in rows}
    pictures = {
        "strains": strains_picture,
        "stiffness": stiffness_picture,
        "fit": fit_picture,
        "residuals": residuals_picture,
        "causes": causes_picture,
        "effects": effects_picture,
        "sources": sources_picture,
        "zones": zones_picture,
    }
    known = known_beforehand(content)
    scales = scales_with_pressure and "pressure" not in known
    html = read_template(template).render(
        subject=subject,
        study=study,
        synthetic=source == "synthetic",
        data_from=SOURCES[source],
        pictures=embedded(pictures),
        heart=Markup(heart3d.draw(mesh, parameters, means, _hover(rows, table, parameters)))
        if mesh
        else "",
        plotly=Markup(get_plotlyjs()) if mesh else "",
        measured=measured_of(table, channels),
        missing=missing(table, channels),
        pressure=pressure_mmhg,
        known=known,
        scaling=[p.factor for p in parameters if p.stress_power][:1] if scales else [],
        measure=seth_hill.measure_name(strain_exponent),
        stiffness=rows,
        law=MATERIALS[parameters.law],
        factors=[f for f in MATERIALS[parameters.law].factors if f.name in parameters.factors],
        trade_offs=trade_offs(drawn, parameters),
        silent=silent(rows, table, channels, parameters),
        fit=fit_of(drawn),
        moved=MOVED,
        extended=extended,
        draws=next(iter(drawn.draws.values())).size,
        emulator=emulator_of(emulator, choice, predictions, table),
        limitations=limitations,
        notes=notes,
        **criticism_of(content),
    )
    Path(page).write_text(html)


def make_page_of_several(
    findings: str | Path,
    residuals_picture: str | Path,
    causes_picture: str | Path,
    effects_picture: str | Path,
    sources_picture: str | Path,
    page: str | Path,
    extended: str = "",
    template: str | Path = SEVERAL,
) -> None:
    """Write the page of several hearts whose causes were searched together.

    findings: JSON of the criticism; pictures: of `plots.criticism` (PNG); extended: as for
    `make_page`.
    """
    content = read_findings(findings)
    pictures = {
        "residuals": residuals_picture,
        "causes": causes_picture,
        "effects": effects_picture,
        "sources": sources_picture,
    }
    html = read_template(template).render(
        pictures=embedded(pictures), extended=extended, **criticism_of(content)
    )
    Path(page).write_text(html)


def read_template(path: str | Path) -> jinja2.Template:
    """A template, which can include others of its folder."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(path).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["label"] = lambda name: Markup(heart3d.html_label(name))
    environment.globals["words"] = words
    return environment.get_template(Path(path).name)


def embedded(pictures: Mapping[str, str | Path | None]) -> dict[str, str]:
    """Pictures (PNG) as the addresses of themselves, for a page that needs no other file."""
    return {
        name: "data:image/png;base64," + base64.b64encode(Path(png).read_bytes()).decode()
        if png
        else ""
        for name, png in pictures.items()
    }


# ------------------------------------------------------------------------------- what is wrong


def criticism_of(content: Findings) -> dict:
    """What the parts of the page on the criticism show: the findings `f`, and the rest of them."""
    separating, untrusted = words.separating(content), words.untrusted(content)
    inputs = sorted(content["measured_inputs"], key=_change, reverse=True)
    return {
        "f": content,
        "untrusted": untrusted,
        "separating": separating,
        "verdict": [s for s in content["words"] if s not in (untrusted, *separating)],
        "families": FAMILIES,
        "inputs": {"first": inputs[:SHOWN_INPUTS], "rest": inputs[SHOWN_INPUTS:]},
        "shows_effects": any(h["posterior"] for h in content["hypotheses"]),
    }


def _change(known: MeasuredInput) -> float:
    """By how many of its sds an input moved from what was known of it."""
    return abs(known["averaged"]["mean"] - known["prior_mean"]) / known["prior_sd"]


def known_beforehand(content: Findings) -> dict[str, float]:
    """Kinds of inputs that are not taken as exact, with the largest sd of each, in its unit."""
    kinds: dict[str, float] = {}
    for one in content["measured_inputs"]:
        kind = words.variance_source(one["name"])
        kinds[kind] = max(kinds.get(kind, 0.0), one["prior_sd"])
    return kinds


# ------------------------------------------------------------------------------- what was measured


def measured_of(table: pd.DataFrame, channels: Channels) -> list[dict]:
    """Rows of the table of measurements: a value that belongs to the whole ventricle or to a pair
    of levels, or a quantity of segments with their number, mean and range; by load."""
    rows = []
    for (quantity, load), part in table.groupby(["quantity", "load_fraction"], sort=False):
        segments = part["segment"].notna()
        observed = [c for c in channels if (c.quantity, c.load_fraction) == (quantity, load)]
        for _, row in part[~segments].iterrows():
            channel = Channel.parse(row["output"])
            rows.append(
                {"what": words.channel(row["output"]), "value": f"{row['value']:.4g}"}
                | {"unit": _unit(channel), "sd": row["sd"], "segments": ""}
            )
        part = part[segments]
        if len(part):
            channel = Channel.parse(part["output"].iloc[0])
            low, mean, high = (
                _read(channel, part["value"].agg(how)) for how in ("min", "mean", "max")
            )
            rows.append(
                {
                    "what": f"{channel.kind.words()}{words.load_in_words(load)}",
                    "value": f"{mean} ({low} to {high})",
                    "unit": _read_in(channel),
                    "sd": _scale_of(channel) * part["sd"].mean(),
                    "segments": f"{len(part)} of {len(observed)}",
                }
            )
    return rows


def _unit(channel: Channel) -> str:
    return "" if channel.unit == "1" else channel.unit


def missing(table: pd.DataFrame, channels: Channels) -> list[str]:
    """What the study observes and the table lacks, in words."""
    absent = [c for c in channels if c.name not in set(table["output"])]
    found = []
    for quantity, load in dict.fromkeys((c.quantity, c.load_fraction) for c in absent):
        some = [c for c in absent if (c.quantity, c.load_fraction) == (quantity, load)]
        all_of_it = [c for c in channels if (c.quantity, c.load_fraction) == (quantity, load)]
        if not some[0].kind.is_strain:
            found += [words.channel(c.name) for c in some]
            continue
        text = some[0].kind.words()
        if len(some) < len(all_of_it):
            numbers = ", ".join(str(c.segment) for c in some)
            text += f" of segment{'s' if len(some) > 1 else ''} {numbers}"
        found.append(text + words.load_in_words(load))
    return found


# --------------------------------------------------------------------------------------- stiffness


def stiffness_of(drawn: AveragedPosterior, parameters: StiffnessInputs) -> list[dict]:
    """A row for each parameter: what its summary says, what the prior allowed, probability of being
    above the reference, by how many sds of the model as it is it moves (`shift_sd`), and whether
    the data do not constrain it (`silent`)."""
    shifts = {s["name"]: s["shift_sd"] for s in drawn.stiffness}
    summary, rows = drawn.summary(), []
    for p in parameters:
        values, row = drawn.draws[p.name].ravel(), summary.loc[p.name].to_dict()
        prior = stats.uniform(p.low, p.high - p.low)
        rows.append(
            {
                "name": p.name,
                "zone": p.zone,
                "factor": p.factor,
                "segments": parameters.zones[p.zone],
                **row,
                "prior": (p.low, p.high),
                "above_reference": float((values > 1).mean()),
                "silent": stats.kstest(values, prior.cdf).statistic <= SAME_AS_PRIOR,
                "shift_sd": shifts[p.name],
            }
        )
    return rows


def trade_offs(drawn: AveragedPosterior, parameters: StiffnessInputs) -> list[dict]:
    """Pairs of factors of a zone that are strongly correlated, with their geometric mean."""
    theta = np.stack([drawn.draws[name].ravel() for name in parameters.names], axis=-1)
    means, found = stats.gmean(parameters.table(theta), axis=-1), []
    for z, zone in enumerate(parameters.zones):
        for one, other in combinations(parameters.factors, 2):
            pair = [np.log(drawn.draws[f"{factor}_{zone}"].ravel()) for factor in (one, other)]
            correlation = float(np.corrcoef(pair)[0, 1])
            if abs(correlation) >= STRONG:
                low, middle, high = np.quantile(means[:, z], [0.025, 0.5, 0.975])
                found.append(
                    {"zone": style.zone_label(zone), "pair": (one, other), "r": correlation}
                    | {"mean": middle, "low": low, "high": high}
                )
    return found


def silent(
    rows: list[dict], table: pd.DataFrame, channels: Channels, parameters: StiffnessInputs
) -> list[dict]:
    """Parameters that the data do not constrain, with what was not measured in their zone."""
    found = []
    for row in rows:
        if row["silent"]:
            here = [c for c in channels if c.segment in parameters.zones[row["zone"]]]
            found.append(
                {"name": row["name"]} | {"missing": missing(table, Channels(here)) if here else []}
            )
    return found


def _hover(rows: list[dict], table: pd.DataFrame, parameters: StiffnessInputs) -> list[str]:
    """The label of each segment (17) of the heart: its name, its zone's stiffness, what was
    measured of it."""
    measured = table[table["segment"].notna() & (table["load_fraction"] == 1)]
    labels = []
    for segment in aha.SEGMENTS:
        zone = parameters.zone_of(segment.number)
        lines = [f"<b>segment {segment.number}, {segment.name}</b>"]
        lines += [
            f"{heart3d.html_label(row['name'])}: {row['mean']:.2f} "
            f"({row['lower95']:.2f} to {row['upper95']:.2f})"
            for row in rows
            if row["zone"] == zone
        ]
        own = measured[measured["segment"] == segment.number]
        for name, value in zip(own["output"], own["value"], strict=True):
            channel = Channel.parse(name)
            text = f"{channel.kind.words()}: {_read(channel, value)} {_read_in(channel)}"
            lines.append(text.rstrip())
        labels.append("<br>".join(lines))
    return labels


# --------------------------------------------------------------------------------------------- fit


def fit_of(drawn: AveragedPosterior) -> dict:
    """How a posterior predicts what was measured.

    `quantities`: by quantity the number of channels, of those outside their 95 % interval, and the
    root mean square of measured minus median. `outside`: these channels, the farthest first.
    """
    predicted, observed = drawn.prediction
    observed = observed.dropna()
    draws = predicted.sel(output=observed.index.to_list()).stack(draw_of=("chain", "draw"))
    low, median, high = np.quantile(
        draws.transpose("output", "draw_of").to_numpy(), [0.025, 0.5, 0.975], axis=1
    )
    table = pd.DataFrame({"observed": observed, "low": low, "median": median, "high": high})
    table["outside"] = ~table["observed"].between(table["low"], table["high"])
    table["far"] = (table["observed"] - table["median"]).abs() / (table["high"] - table["low"])
    table["quantity"] = [Channel.parse(name).quantity for name in table.index]
    quantities = []
    for _, part in table.groupby("quantity", sort=False):
        channel = Channel.parse(part.index[0])
        error = float(np.sqrt(((part["observed"] - part["median"]) ** 2).mean()))
        quantities.append(
            {
                "what": channel.kind.words(),
                "channels": len(part),
                "outside": int(part["outside"].sum()),
            }
            | _as_read(channel, error)
        )
    outside = []
    for name, row in table[table["outside"]].sort_values("far", ascending=False).iterrows():
        scale = _scale_of(Channel.parse(name))
        values = {key: scale * row[key] for key in ("observed", "median", "low", "high")}
        outside.append(
            {"what": words.channel(name), "unit": _read_in(Channel.parse(name))} | values
        )
    return {"quantities": quantities, "outside": outside, "channels": len(table)}


def _scale_of(channel: Channel) -> float:
    """Strains are read in per cent."""
    return 100.0 if channel.kind.is_strain else 1.0


def _read_in(channel: Channel) -> str:
    return "%" if channel.kind.is_strain else _unit(channel)


def _read(channel: Channel, value: float) -> str:
    """A value as it is read, without its unit."""
    return f"{_scale_of(channel) * value:{'.1f' if channel.kind.is_strain else '.4g'}}"


def _as_read(channel: Channel, error: float) -> dict:
    return {"error": _scale_of(channel) * error, "unit": _read_in(channel)}


# ---------------------------------------------------------------------------------------- how sure


def emulator_of(
    name: str,
    choice: str | Path | None,
    predictions: str | Path | None,
    measured: pd.DataFrame,
) -> dict:
    """What the emulator gets wrong on the test set, beside the noise of the measurement.

    `quantities`: by quantity its root mean square error and the mean sd of the subject's channels,
    NaN where these give none.
    """
    if choice:
        name = json.loads(Path(choice).read_text())["final"]
    columns = ["case", "output", "truth", "mean"]
    table = (
        pd.read_parquet(predictions, columns=columns)
        if predictions
        else pd.DataFrame(columns=columns)
    )
    table["quantity"] = [Channel.parse(output).quantity for output in table["output"]]
    rows = []
    for quantity, part in table.groupby("quantity", sort=False):
        channel = Channel.parse(part["output"].iloc[0])
        sd = measured.loc[measured["quantity"] == quantity, "sd"].mean()
        rows.append(
            {"what": channel.kind.words(), "sd": _scale_of(channel) * sd}
            | _as_read(channel, float(np.sqrt(((part["mean"] - part["truth"]) ** 2).mean())))
        )
    return {
        "name": label_of(name),
        "cases": table["case"].nunique(),
        "quantities": rows,
    }
