"""Findings as sentences."""

from collections.abc import Sequence

from regional_lv import aha
from regional_lv.channels import Channel
from regional_lv.criticism.contract import Cause, Findings, Gain, Misfit, Set
from regional_lv.inputs.catalogue import INPUTS
from regional_lv.inputs.closed_forms import EndDiastolicPressure
from regional_lv.quantities import QUANTITIES
from regional_lv.units import after_number

SEGMENT_NAMES = {s.number: s.name for s in aha.SEGMENTS}

SOURCES = {
    "noise": "noise",
    "emulator": "emulator",
    "ranges": "ends of ranges",
    "models": "doubt about the model",
}
"""Sources of variance (`contract.Stiffness`) that are no measured inputs, as readers see them."""


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
    return text + load_in_words(found.load_fraction)


def load_in_words(fraction: float) -> str:
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
    return f"{number(value)}{after_number(unit)}"


def p_value(p: float) -> str:
    return f"p = {p:.3f}" if p >= 0.0095 else f"p = {p:.2g}"


def estimate(cause: Cause) -> str:
    """Estimate with its interval and unit."""
    unit = "" if cause["unit"] == "1" else f" {cause['unit']}"
    low, high = cause["interval95"]
    return (
        f"{number(cause['estimate'])}{unit} (95 % interval {number(low)} to "
        f"{number(high)}{unit}; the model assumes {number(cause['base'])})"
    )


def misfit(part: Misfit) -> str:
    """One or two sentences: whether the model misses the data, where, which way."""
    if not part["families"]:
        return "There are too few channels to test the model."
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
    """What the best set gains; empty without one."""
    if part["elpd"] is None:
        return ""
    text = (
        f"Predicting each segment from all others gains {part['elpd']:.1f} +- "
        f"{number(part['elpd_se'], 2)} in log density"
    )
    if part["rmse_before"] is not None:
        text += (
            f"; the error of such predictions goes from {number(part['rmse_before'])} to "
            f"{number(part['rmse_after'])} in strain"
        )
    return (
        f"{text}; their 95 % intervals hold {100 * part['coverage_before']:.0f} % of the channels "
        f"before and {100 * part['coverage_after']:.0f} % after."
    )


def percent(probability: float) -> str:
    """A probability that is never written as 0 or 100 %."""
    share = 100 * probability
    if share < 0.1:
        return "less than 0.1 %"
    if share > 99.9:
        return "more than 99.9 %"
    return f"{share:.1f} %" if share < 1 or share > 99 else f"{share:.0f} %"


# ------------------------------------------------------------------------------------- inputs


def input_in_words(name: str) -> str:
    """`wall_thickness_3` as "wall thickness of segment 3"."""
    stem, segment = _of_segment(name)
    text = stem.replace("_", " ")
    return f"{text} of segment {segment}" if segment else text


def variance_source(name: str) -> str:
    """What a source of variance is called; of measured inputs the kind: "geometry"."""
    if name in SOURCES:
        return SOURCES[name]
    if name == EndDiastolicPressure.name:
        return "pressure"
    family = _family(name)
    return {"shape": "geometry", "": input_in_words(name)}.get(family, family)


def _family(name: str) -> str:
    """Of an input; empty if the catalogue does not know it."""
    stem, _ = _of_segment(name)
    kinds = (k for k in INPUTS.values() if stem in (k.name, getattr(k, "stem", None)))
    return next((kind.family for kind in kinds), "")


def _of_segment(name: str) -> tuple[str, str]:
    """Name of the kind, and the segment's number if there is one."""
    stem, _, last = name.rpartition("_")
    return (stem, last) if stem and last.isdigit() else (name, "")


# ------------------------------------------------------------------------------------ verdict


def answer(content: Findings) -> str:
    """One sentence: what is wrong with the model, and how probable the model as it is is."""
    groups = [f"one of {_list(_called(content, group), 'or')}" for group in content["groups"]]
    if not content["misfit"]["detected"]:
        text = "The model as it is fits the measurements"
        if _is_improbable(content):
            text = "The tests find no misfit, but other models are far more probable"
    elif content["explained"] and (content["named"] or groups):
        found = [*_called(content, content["named"]), *groups]
        text = f"{certainty(content)}: {_list(found)}"
    else:
        text = "The model as it is misses the measurements, and no cause is named"
    probability = percent(content["base_probability"])
    return f"{text}. The model as it is has a probability of {probability}."


def untrusted(content: Findings) -> str:
    """That no stiffness can be trusted, and what was tried; empty if it can."""
    if content["trusted"]:
        return ""
    tried = [f"the model as it is ({p_value(content['misfit']['p_value'])})"]
    if content["hypotheses"]:
        sets = f"sets of {len(content['hypotheses'])} listed causes"
        if content["best"] and content["remaining"]:
            names = causes(content, content["best"])
            sets += f", of which {names} ({p_value(content['remaining']['p_value'])}) is the best"
        tried.append(sets)
    tried.append("a smooth departure of no listed shape")
    if content["outliers"]:
        tried.append("heavy tails of the noise")
    return (
        "No stiffness of this heart can be trusted: every model that was tried misses the "
        f"measurements by more than their noise. Tried: {'; '.join(tried)}."
    )


def verdict(content: Findings) -> list[str]:
    """The verdict in sentences, from the findings."""
    sentences = [untrusted(content), misfit(content["misfit"])]
    sentences += [_of_check(content, c) for c in content["data_checks"] if not c["passed"]]
    if not content["misfit"]["detected"]:
        sentences.append(_not_found(content))
    elif content["explained"]:
        sentences += _explained(content)
    else:
        sentences += _not_explained(content)
    sentences += _proxies(content)
    told = {*content["named"], *content["acts_like"], *(content["best"] or ())}
    told = told.union(*content["groups"])
    for found in content["hypotheses"]:
        if not found["identifiable"] and found["name"] not in told:
            sentences.append(
                f"Nothing can be concluded about {cause(found['name'])}: {found['why']}."
            )
    return [sentence for sentence in sentences if sentence]


def _sentence(text: str) -> str:
    """With a capital; names within it keep theirs."""
    return text[:1].upper() + text[1:]


def _of_check(content: Findings, check: dict) -> str:
    return f"{_of_heart(content, check)}{_sentence(check['says'])}."


def _of_heart(content: Findings, found: dict) -> str:
    """Which of several hearts something is of."""
    return f"{found['subject']}: " if len(content["subjects"]) > 1 else ""


def _is_improbable(content: Findings) -> bool:
    """Whether the others together are all but certain, beside the model as it is."""
    return content["base_probability"] < 1 - content["least_probability"]


def _not_found(content: Findings) -> str:
    text = "No cause was found."
    if not content["hypotheses"]:
        text = "No cause was searched: the emulator knows no input that is suspected."
    if not _is_improbable(content):
        return text
    if content["hypotheses"]:
        text = "No cause is named, since the tests find no misfit."
    first, unlisted = next(iter(content["sets"]), None), content["unlisted_probability"]
    if first and first["probability"] > unlisted:
        others = (
            f"The most probable set of causes has {percent(first['probability'])}: "
            f"{_placed(first['causes'], first['components'])}."
        )
    else:
        others = f"A smooth departure of no listed shape has {percent(unlisted)}."
    return (
        f"{text} But the model as it is has a probability of "
        f"{percent(content['base_probability'])} only: something is probably wrong, and the data "
        f"do not tell what. {others}"
    )


def best_set(content: Findings) -> Set | None:
    """That on which stands what is named."""
    return next((s for s in content["sets"] if s["best"]), None)


def certainty(content: Findings) -> str:
    """ "Named", or "Suspected" where no simulations confirm the best set."""
    best = best_set(content)
    return "Named" if best is not None and best["confirmed"] else "Suspected"


def causes(content: Findings, names: Sequence[str]) -> str:
    """Several causes, each with its place: "septal load and focal scar in segment 7 (...)"."""
    return _list(_called(content, names))


def _cause_of(content: Findings, name: str) -> Cause:
    return next(found for found in content["hypotheses"] if found["name"] == name)


def _called(content: Findings, names: Sequence[str]) -> list[str]:
    return [cause(name, _cause_of(content, name)["component"]) for name in names]


def _placed(names: Sequence[str], components: Sequence[str]) -> str:
    """The causes of a set, in its own places."""
    return _list([cause(*at) for at in zip(names, components, strict=True)])


def _estimated(content: Findings, name: str) -> str:
    found = _cause_of(content, name)
    return f"{cause(name, found['component'])}, {found['parameter']} {estimate(found)}"


def _explained(content: Findings) -> list[str]:
    sentences = [_named(content, name) for name in content["named"]]
    for group in content["groups"]:
        likeliest = max(group, key=lambda name: _cause_of(content, name)["probability"])
        sentences.append(
            f"One of {_list(_called(content, group), 'or')} is present; the data cannot tell "
            f"which. The most probable is {_estimated(content, likeliest)}."
        )
    known = {*content["named"], *content["acts_like"]}.union(*content["groups"])
    uncertain = _called(content, [name for name in content["best"] or () if name not in known])
    if uncertain:
        verb = "is" if len(uncertain) == 1 else "are"
        sentences.append(
            f"The best set also holds {_list(uncertain)}, which {verb} not certain enough to be "
            "named."
        )
    others = {
        "The model as it is": content["base_probability"],
        "A smooth departure of no listed shape": content["unlisted_probability"],
    }
    sentences += [
        f"{what} has a probability of {percent(share)}."
        for what, share in others.items()
        if share >= 1 - content["least_probability"]
    ]
    sentences += separating(content)
    return [*sentences, *confirmation(content), gain(content["gain"])]


def _named(content: Findings, name: str) -> str:
    found = _cause_of(content, name)
    text = (
        f"{certainty(content)}: {_estimated(content, name)}; probability "
        f"{percent(found['probability'])} among all sets of the {len(content['hypotheses'])} "
        "causes searched"
    )
    if found["component_probability"] < content["least_probability"]:
        kind = "segment" if (found["component"] or "").isdigit() else "kind"
        text += f", {percent(found['component_probability'])} of that for this {kind}"
    return f"{text}."


def _not_explained(content: Findings) -> list[str]:
    sentences = [f"No listed cause explains the misfit{_why_not(content)}."]
    if content["outliers"]:
        sentences.append(f"Nor do heavy tails of the noise: {content['outliers']}.")
    if content["best"]:
        names = causes(content, content["best"])
        sentences.append(f"The best set is {names}; it is not named.")
        sentences += [*confirmation(content), gain(content["gain"])]
    return sentences


def _why_not(content: Findings) -> str:
    remaining, nothing = content["remaining"], content["base_probability"]
    unlisted, best = content["unlisted_probability"], best_set(content)
    if not content["sets"]:
        return ": there was none to try"
    if unlisted > 0.5:
        return ": a smooth departure of no listed shape fits better than any set of causes"
    if best is None and content["confirmation"]["simulations"]:
        return ": no simulation confirms the most probable set of them"
    if remaining is None or best is None:
        return ": there are too few channels to test the best set of them"
    if remaining["detected"]:
        return f" ({p_value(remaining['p_value'])} remains with the best set of them)"
    if nothing > 0.5:
        return ": the model as it is remains the most probable"
    if content["acts_like"]:
        return ": an estimate is at the end of its plausible range"
    if 1 - best["probability"] - nothing - unlisted < nothing + unlisted:
        return (
            f": the best set of them fits, but has a probability of {best['probability']:.2f} "
            f"only, the model as it is {nothing:.2f}, and a smooth departure of no listed shape "
            f"{unlisted:.2f}"
        )
    return ": several sets do as well, and have too little in common"


def _proxies(content: Findings) -> list[str]:
    much = "but the data require more than its plausible range: it is not named."
    if content["explained"]:
        how = "Something else acts like {}, {}"
    else:
        how = "Of the listed causes {}, comes nearest, {}"
    return [how.format(_estimated(content, name), much) for name in content["acts_like"]]


def separating(content: Findings) -> list[str]:
    """Which measurement would tell apart the sets of causes that explain the data equally well."""
    sentences = []
    for pair in content["separating"]:
        best = pair["channels"][0]
        a, b = (
            _placed(names, components)
            for names, components in zip(pair["pair"], pair["components"], strict=True)
        )
        gap = abs(best["difference_in_noise_sd"])
        what = _sentence(f"{channel(best['output'])}{load_in_words(best['load_fraction'])}")
        sentences.append(
            f"{_of_heart(content, best)}{what} would "
            f"separate {a} from {b} best: they differ there by {gap:.1f} sd "
            f"of a noise of {_with_unit(best['noise'], Channel.parse(best['output']).unit)}."
        )
    return sentences


def confirmation(content: Findings) -> list[str]:
    """What the simulations of the leading models say of the emulator that the answer rests on."""
    part, best = content["confirmation"], best_set(content)
    if not part["simulations"]:
        failed = [_failed(part["failed"])] if part["failed"] else []
        return [*failed, "No simulation stands behind this: it rests on the emulator alone."]
    known = _simulations(part["simulations"])
    sentences = []
    if part["emulator_error_sd"]:
        verdict = "agrees" if part["agrees"] else "does not agree"
        first, last = part["emulator_error_sd"][0], part["emulator_error_sd"][-1]
        text = (
            f"The emulator {verdict} with {known} at draws of the leading models, "
            f"{part['simulations_of_best']} of them of the best set: simulated minus emulated is "
            f"{number(last, 2)} times the sds that it states (root mean square"
        )
        if part["largest_error_sd"] is not None:
            text += f"; {number(part['largest_error_sd'], 2)} in the worst channel"
        if len(part["emulator_error_sd"]) > 1:
            text += f"; {number(first, 2)} before it learned from the first of them"
        sentences.append(f"{text}).")
    if part["agrees"] and best is not None and not best["confirmed"]:
        sentences.append("The best set is not confirmed: too few simulations of it are known.")
    if part["failed"]:
        sentences.append(_failed(part["failed"]))
    if (share := part["probability_not_simulated"]) >= 1 - content["least_probability"]:
        sentences.append(
            f"Sets that were never simulated have {percent(share)} of the probability: more "
            "simulations may change this."
        )
    return sentences


def _simulations(count: int) -> str:
    return "1 simulation" if count == 1 else f"{count} simulations"


def _failed(count: int) -> str:
    return f"{_simulations(count)} did not converge."


def _list(names: list[str], last: str = "and") -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"
