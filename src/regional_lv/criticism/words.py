"""Findings as sentences."""

from regional_lv import aha
from regional_lv.channels import Channel
from regional_lv.criticism.contract import Cause, Findings, Gain, Misfit
from regional_lv.quantities import QUANTITIES

FARTHEST = 4.0
"""How far an estimate may be from those that were simulated, in their sds, for their correction to
be taken as it is. Of the best sets of 31 subjects of the benchmark 28 are within 1.4, one at 3.2,
the others at 5.7 and 17."""

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
    """`focal_scar` in segment 7 as "focal scar in segment 7"; a kind stands in brackets."""
    text = name.replace("_", " ")
    if not component:
        return text
    if not component.isdigit():
        return f"{text} ({component})"
    return f"{text} in segment {component} ({SEGMENT_NAMES[int(component)]})"


def number(value: float | None, digits: int = 3) -> str:
    return "unknown" if value is None else f"{value:.{digits}g}"


def _with_unit(value: float, unit: str) -> str:
    return number(value) if unit == "1" else f"{number(value)} {unit}"


def p_value(p: float) -> str:
    return f"p = {p:.3f}" if p >= 0.0095 else f"p = {p:.2g}"


def estimate(hypothesis: Cause) -> str:
    """Estimate with its interval and unit."""
    unit = "" if hypothesis["unit"] == "1" else f" {hypothesis['unit']}"
    low, high = hypothesis["interval95"]
    return (
        f"{number(hypothesis['estimate'])}{unit} (95 % interval {number(low)} to "
        f"{number(high)}{unit}; the model assumes {number(hypothesis['base'])})"
    )


def misfit(part: Misfit) -> str:
    """One or two sentences: whether the model misses the data, where, which way."""
    p = p_value(part["p_value"])
    if not part["families"]:
        return "There are too few channels to test the model."
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
        sentences = []
        for x in single[:3]:
            row = rows.get(x["what"])
            if row:
                heart = x["what"].removesuffix(row["output"])
                sentences.append(
                    f"{heart}{channel(row['output'])} is {number(row['observed'])} where "
                    f"{number(row['predicted'])} +- {number(row['sd'], 2)} is predicted from the "
                    "others"
                )
        text += f" Single channels: {'; '.join(sentences)}."
    return text


def _plural(what: str) -> str:
    """`basal radial` as "basal radial strains"."""
    is_strain = QUANTITIES[what.rpartition(" ")[2]].is_strain
    return f"{what} {'strains' if is_strain else 'values'}"


def gain(part: Gain) -> str:
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


def verdict(content: Findings) -> list[str]:
    """The verdict in sentences, from the findings."""
    sentences = [misfit(content["misfit"])]
    sentences += [f"{c['says'].capitalize()}." for c in content["data_checks"] if not c["passed"]]
    by_name = {h["name"]: h for h in content["hypotheses"]}
    answer = {*content["named"], *content["acts_like"]}.union(*content["groups"])
    told = answer | {*(content["best"] or ())}

    def of(name: str) -> str:
        return cause(name, by_name[name]["component"])

    def estimated(name: str) -> str:
        h = by_name[name]
        return f"{of(name)}, {h['parameter']} {estimate(h)}"

    if not content["misfit"]["detected"]:
        sentences.append("No cause was found.")
    elif content["explained"]:
        for name in content["named"]:
            h = by_name[name]
            sentence = (
                f"Named: {estimated(name)}; probability {min(100 * h['probability'], 99.9):.1f} % "
                f"among all sets of the {len(by_name)} causes searched"
            )
            if h["component_probability"] < content["least_probability"]:
                kind = "segment" if (h["component"] or "").isdigit() else "kind"
                sentence += f", {100 * h['component_probability']:.0f} % of that for this {kind}"
            sentences.append(f"{sentence}.")
        for group in content["groups"]:
            likeliest = max(group, key=lambda name: by_name[name]["probability"])
            sentences.append(
                f"One of {_list([of(n) for n in group], 'or')} is present; the data cannot tell "
                f"which. The most probable is {estimated(likeliest)}."
            )
        uncertain = [of(name) for name in content["best"] or () if name not in answer]
        if uncertain:
            verb = "is" if len(uncertain) == 1 else "are"
            sentences.append(
                f"The best set also holds {_list(uncertain)}, which {verb} not certain enough to "
                "be named."
            )
        sentences += _not_simulated(content, bool(uncertain or content["groups"]))
        sentences += separating(content)
        sentences += _confirmed(content)
        sentences.append(gain(content["gain"]))
    else:
        if content["sets"] and content["best"] is None:
            sentences += _unconfirmed(content)
        else:
            sentences.append(f"No listed cause explains the misfit{_why_not(content)}.")
        if content["outliers"]:
            sentences.append(f"Nor do heavy tails of the noise: {content['outliers']}.")
        if content["best"]:
            names = [of(n) for n in content["best"]]
            sentences.append(f"The best set is {_list(names)}; it is not named.")
            sentences += _not_simulated(content, undecided=True)
            sentences.append(gain(content["gain"]))
    for name in content["acts_like"]:
        much = "but the data require more than its plausible range: it is not named."
        if content["explained"]:
            sentences.append(f"Something else acts like {estimated(name)}, {much}")
        else:
            sentences.append(f"Of the listed causes {estimated(name)}, comes nearest, {much}")
    for h in content["hypotheses"]:
        if not h["identifiable"] and h["name"] not in told:
            sentences.append(f"Nothing can be concluded about {cause(h['name'])}: {h['why']}.")
    return sentences


def _why_not(content: Findings) -> str:
    remaining, nothing = content["remaining"], content["base_probability"]
    unlisted = content["unlisted_probability"]
    if not content["sets"]:
        return ": there was none to try"
    if unlisted > 0.5:
        return ": a smooth departure of no listed shape fits better than any set of causes"
    if remaining is None:
        return ": there are too few channels to test the best set of them"
    if remaining["detected"]:
        return f" ({p_value(remaining['p_value'])} remains with the best set of them)"
    if nothing > 0.5:
        return ": the model as it is remains the most probable"
    if content["acts_like"]:
        return ": an estimate is at the end of its plausible range"
    best = next(s["probability"] for s in content["sets"] if s["causes"] == content["best"])
    if 1 - best - nothing - unlisted < nothing + unlisted:
        return (
            f": the best set of them fits, but has a probability of {best:.2f} only, the model as "
            f"it is {nothing:.2f}, and a smooth departure of no listed shape {unlisted:.2f}"
        )
    return ": several sets do as well, and have too little in common"


def _unconfirmed(content: Findings) -> list[str]:
    sentences = ["No cause is named: no set was confirmed by simulation."]
    certain = [h for h in content["hypotheses"] if h["probability"] >= content["least_probability"]]
    if certain:
        names = _list([f"{cause(h['name'], h['component'])} {estimate(h)}" for h in certain])
        sentences.append(f"By the emulators alone, these causes are certain: {names}.")
    return [*sentences, *_not_simulated(content, undecided=True)]


def separating(content: Findings) -> list[str]:
    """Which measurement would tell apart the sets of causes that explain the data equally well."""
    sentences = []
    for pair in content["separating"]:
        best = pair["channels"][0]
        a, b = (
            _list([cause(*at) for at in zip(names, components, strict=True)])
            for names, components in zip(pair["pair"], pair["components"], strict=True)
        )
        gap = abs(best["difference_in_noise_sd"])
        sentences.append(
            f"{channel(best['output']).capitalize()}{at_load(best['load_fraction'])} would "
            f"separate {a} from {b} best: they differ there by {gap:.1f} sd "
            f"of a noise of {_with_unit(best['noise'], Channel.parse(best['output']).unit)}."
        )
    return sentences


def _confirmed(content: Findings) -> list[str]:
    part = content["confirmation"]
    if not part["simulations"] or part["largest_difference_sd"] is None:
        return []
    return [
        f"Confirmed by {part['simulations_of_best']} simulations with all effects at once; "
        f"emulated and simulated differ by {number(part['largest_difference_sd'], 2)} sd of the "
        "noise at most, which was corrected."
    ]


def _not_simulated(content: Findings, undecided: bool) -> list[str]:
    """What sets have of the probability that no simulation stands behind, or none about their
    estimates.

    undecided: whether that may be why causes are not named.
    """
    part, least = content["confirmation"], 1 - content["least_probability"]
    what = "tell more" if undecided else "change estimates"
    sentences = []
    if (share := part["probability_not_simulated"]) >= least:
        sentences.append(
            f"Sets that were not simulated have {100 * share:.0f} % of the probability: more "
            f"rounds (criticism.confirmation.rounds) may {what}."
        )
    if (share := part["probability_failed"]) >= least:
        sentences.append(
            f"Sets whose simulations did not converge have {100 * share:.0f} % of the probability."
        )
    if (share := part["probability_elsewhere"]) >= least:
        sentences.append(
            f"Sets that were simulated far from their estimates have {100 * share:.0f} % of the "
            f"probability, by extrapolation: more rounds may {what}."
        )
    return sentences


def _list(names: list[str], last: str = "and") -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"
