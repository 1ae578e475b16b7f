"""The values that set the scale of the answer, in their units, and where each comes from; and what
counts as measured with an error or is suspected."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pandas as pd

from regional_lv.inputs.space import Inputs
from regional_lv.measured.tables import VOLUME_SHARE
from regional_lv.quantities import QUANTITIES
from regional_lv.units import after_number

Layers = Sequence[tuple[Path, Mapping]]
"""Files of a configuration and what they hold, the one that counts first first."""


def origin(layers: Layers, *keys: str) -> str:
    """A key, and the first file that gives it a value, or `default`."""
    for file, content in layers:
        value: object = content
        for key in keys:
            value = value.get(key) if isinstance(value, Mapping) else None
        if value is not None:
            return f"{'.'.join(keys)}, {file}"
    return f"{'.'.join(keys)}, default"


def heart_lines(
    config: Mapping, layers: Layers, cavity_ml: float, wall_ml: float, geometry: str
) -> Iterator[str]:
    """Pressure and volumes without load; geometry: the file or files that the heart is made of."""
    pressure = config["loading"]["pressure_mmhg"]
    at = origin(layers, "loading", "pressure_mmhg")
    yield f"end-diastolic pressure: {pressure:g} mmHg ({at})"
    yield f"unloaded heart: cavity {cavity_ml:.1f} mL, wall {wall_ml:.1f} mL ({geometry})"


def role_lines(inputs: Inputs) -> Iterator[str]:
    """What is measured, with its standard deviations, and what is suspected, by kind."""
    sds: dict[str, set[str]] = {}
    suspected: dict[str, None] = {}
    for each, role in zip(inputs, inputs.roles, strict=True):
        if role.kind == "measured":
            sd = f"{role.sd:.3g}{after_number(each.unit)}"
            sds.setdefault(type(each).name, set()).add(sd)
        elif role.kind == "suspected":
            suspected[type(each).name] = None
    known = [f"{kind} (sd {' or '.join(sorted(of_kind))})" for kind, of_kind in sds.items()]
    yield f"measured, and integrated out: {', '.join(known) or 'nothing; all else counts as exact'}"
    yield f"suspected: {', '.join(suspected) or 'nothing; no cause of a misfit is searched'}"


def subject_lines(
    name: str,
    subject: Mapping,
    layers: Layers,
    table: pd.DataFrame,
    frames: Mapping[str, int],
) -> Iterator[str]:
    """Volume, noise, frames and strain measure of a measured subject.

    subject: its entry in the complete configuration. table: its measured table. frames: those that
    were taken of curves, by the key that asks for them.
    """
    of_curves = subject["source"] == "curves"

    def where(*keys: str) -> str:
        return origin(layers, "subjects", name, *keys)

    if of_curves:
        rule = f", by {subject['frame']}" if isinstance(subject["frame"], str) else ""
        taken = [
            f"unloaded frame {frames['frame']}{rule} ({where('frame')})",
            f"end-diastolic frame {frames['end_diastole_frame']} ({where('end_diastole_frame')})",
        ]
        yield "; ".join([*taken, f"{subject['measure']} strain ({where('measure')})"])
    elif "frame" in table:
        named = ", ".join(dict.fromkeys(table["frame"].dropna()))
        yield f"frame {named} (column frame, {subject['measured']})"
    for _, row in table[table["quantity"] == "volume"].iterrows():
        at = (
            "" if row["load_fraction"] == 1 else f" at {100 * row['load_fraction']:g} % of the load"
        )
        origins = [where("volume_ml"), where("sd", "volume")] if of_curves else None
        value, sd = origins or [f"column {c}, {subject['measured']}" for c in ("value", "sd")]
        unknown = f"known to {100 * VOLUME_SHARE:g} %"
        noise = unknown if pd.isna(row["sd"]) else f"sd {row['sd']:g} mL"
        yield f"volume{at} {row['value']:g} mL ({value}), {noise} ({sd})"
    at = where("sd", "strain") if of_curves else f"column sd, {subject['measured']}"
    others = table[table["quantity"] != "volume"]
    if others["sd"].isna().all():
        yield f"sd of the strains not given: the noise is inferred ({at})"
    elif len(others):
        yield f"sd of {', '.join(_spread(others))} (strains as fractions; {at})"


def _spread(rows: pd.DataFrame) -> Iterator[str]:
    """The sd of each quantity, and of all strains at once if they have the same."""
    strains = rows["quantity"].map(lambda name: QUANTITIES[name].is_strain)
    same = rows["sd"][strains].nunique() == 1
    for what, own in rows.groupby(rows["quantity"].mask(strains & same, "the strains"), sort=False):
        unit = QUANTITIES[own["quantity"].iloc[0]].unit
        ends = dict.fromkeys(f"{sd:.3g}" for sd in (own["sd"].min(), own["sd"].max()))
        yield f"{what} {' to '.join(ends)}{after_number(unit)}"
