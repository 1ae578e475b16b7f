"""Findings in plain words."""

from regional_lv import aha
from regional_lv.channels import Channel
from regional_lv.quantities import QUANTITIES

SEGMENT_NAMES = {s.number: s.name for s in aha.SEGMENTS}


def channel(output: str) -> str:
    """`radial_07` as "radial strain of segment 7 (mid anterior)"."""
    found = Channel.parse(output)
    text = f"{found.quantity} strain" if found.kind.is_strain else found.quantity
    if found.segment is not None:
        text += f" of segment {found.segment} ({SEGMENT_NAMES[found.segment]})"
    elif found.place:
        text += f" {found.place}"
    else:
        text = f"the {text}"
    return text + at_load(found.load_fraction)


def at_load(fraction: float) -> str:
    """` at 50 % of the end-diastolic pressure`; nothing at the full one."""
    return "" if fraction == 1 else f" at {100 * fraction:.0f} % of the end-diastolic pressure"


def cause(name: str, component: str | None = "") -> str:
    """`focal_scar` in segment 7 as "focal scar in segment 7"."""
    text = name.replace("_", " ")
    return f"{text} in segment {component} ({SEGMENT_NAMES[int(component)]})" if component else text


def number(value: float | None, digits: int = 3) -> str:
    return "unknown" if value is None else f"{value:.{digits}g}"


def _with_unit(value: float, unit: str) -> str:
    return number(value) if unit == "1" else f"{number(value)} {unit}"


def p_value(p: float) -> str:
    return f"p = {p:.3f}" if p >= 0.0095 else f"p = {p:.2g}"


def estimate(hypothesis: dict) -> str:
    """Estimate with its interval and unit."""
    unit = "" if hypothesis["unit"] == "1" else f" {hypothesis['unit']}"
    low, high = hypothesis["interval95"]
    return (
        f"{number(hypothesis['estimate'])}{unit} (95 % interval {number(low)} to "
        f"{number(high)}{unit}; the model assumes {number(hypothesis['base'])})"
    )


def misfit(part: dict) -> str:
    """One or two sentences: whether the model misses the data, where, which way."""
    p = p_value(part["p_value"])
    if not part["detected"]:
        return f"The model fits the measurements within their noise ({p})."
    groups = [x for x in part["largest"] if x["family"] in ("direction", "level", "wall")]
    groups = sorted((x for x in groups if x["p_value"] <= 0.05), key=lambda x: -abs(x["z"]))
    text = f"The model misses the measurements by more than their noise ({p})."
    if groups:
        names = "; ".join(
            f"{_plural(g['what'])} are {'above' if g['z'] > 0 else 'below'} the prediction (z = "
            f"{g['z']:+.1f})"
            for g in groups[:3]
        )
        text += f" Taken together, {names}."
    single = [x for x in part["largest"] if x["family"] == "channel" and x["p_value"] <= 0.05]
    # Of several hearts, a channel's name is its output's behind its heart's.
    rows = {c["output"]: c for c in part["channels"]}
    rows |= {f"{c['subject']}: {c['output']}": c for c in part["channels"]}
    if single:
        said = []
        for x in single[:3]:
            row = rows.get(x["what"])
            if row:
                heart = x["what"].removesuffix(row["output"])
                said.append(
                    f"{heart}{channel(row['output'])} is {number(row['observed'])} where "
                    f"{number(row['predicted'])} +- {number(row['sd'], 2)} is predicted from the "
                    "others"
                )
        text += f" Single channels: {'; '.join(said)}."
    return text


def _plural(what: str) -> str:
    """`basal radial` as "basal radial strains"."""
    is_strain = QUANTITIES[what.rpartition(" ")[2]].is_strain
    return f"{what} {'strains' if is_strain else 'values'}"


def gain(part: dict) -> str:
    text = (
        f"Predicting each segment from all others gains {part['elpd']:.1f} +- "
        f"{part['elpd_se']:.1f} in log density"
    )
    if part["rmse_before"] is not None:
        text += (
            f"; the error of such predictions goes from {number(part['rmse_before'])} to "
            f"{number(part['rmse_after'])} in strain"
        )
    text += (
        f"; their 95 % intervals hold {100 * part['coverage_before']:.0f} % of the channels before "
        f"and {100 * part['coverage_after']:.0f} % after."
    )
    return text


def verdict(content: dict) -> list[str]:
    """The verdict in sentences, from the findings."""
    said = [misfit(content["misfit"])]
    by_name = {h["name"]: h for h in content["hypotheses"]}
    rounds = content["rounds"]
    if content["named_cause"]:
        h = by_name[content["named_cause"]]
        said.append(
            f"The cause is {cause(h['name'], h['component'])}: {h['parameter']} "
            f"{estimate(h)}. No other listed cause explains the data nearly as well."
        )
        said.append(gain(content["gain"]))
    elif content["indistinguishable"]:
        members = [cause(n, by_name[n]["component"]) for n in content["indistinguishable"]]
        if len(members) == 1:
            said.append(
                f"{members[0].capitalize()} is suspected; what it gains in prediction does not "
                "exceed two standard errors, so it is not named as the cause."
            )
        else:
            said.append(
                f"The data cannot tell {_list(members)} apart: one of them explains the misfit."
            )
        for pair in content["separating"]:
            best = pair["channels"][0]
            a, b = (cause(n) for n in pair["pair"])
            at = at_load(best["load_fraction"])
            said.append(
                f"{channel(best['output']).capitalize()}{at} would separate {a} and {b} best: they "
                f"differ there by {abs(best['difference_in_noise_sd']):.1f} sd of a noise of "
                f"{_with_unit(best['noise'], Channel.parse(best['output']).unit)}."
            )
        said.append(gain(content["gain"]))
    elif not content["explained"]:
        text = "No listed cause explains the misfit."
        if content["partly"]:
            text += (
                f" {_list([cause(n) for n in content['partly']]).capitalize()} would take away a "
                f"part of it, and {p_value(content['remaining']['p_value'])} remains."
            )
        said.append(text)
        if content["partly"]:
            said.append(gain(content["gain"]))
    elif content["misfit"]["detected"]:
        said.append("No listed cause explains the misfit: none of them stands out from chance.")
    else:
        said.append("Nothing was found: no listed cause stands out from chance.")
    more = [r for r in rounds[1:] if r["found"]]
    if more and content["explained"]:
        names = [cause(r["found"], r["found_component"]) for r in more]
        said.append(f"With that in the model, a further effect shows: {_list(names)}.")
    hidden = [h for h in content["hypotheses"] if not h["identifiable"]]
    for h in hidden:
        said.append(f"Nothing can be said about {cause(h['name'])}: {h['why']}.")
    return said


def _list(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
