"""The model with the named causes switched on: a study of its own, and what it changes."""

import json
from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import yaml

from regional_lv.channels import Channel, Channels
from regional_lv.config import physics as physics_of
from regional_lv.criticism.hypotheses import REGISTRY, NoiseHypothesis, asked
from regional_lv.errors import InputError
from regional_lv.measured import read_measured, write_measured


def write_extended(
    findings: str | Path,
    measured: str | Path,
    config: Mapping,
    subject: str,
    extended: str | Path,
    corrected: str | Path,
) -> None:
    """Write the configuration (YAML) of the study with the named causes of one subject, each at its
    estimate, and the subject's measured file as that study reads it.

    config: the study's, complete. Of causes that say at which load a channel was observed, the
    measured file changes; all others change keys of the simulator. Raises InputError if nothing is
    named.
    """
    content = json.loads(Path(findings).read_text())
    if not content["named"]:
        raise InputError(
            f"{findings}: no cause is named, so that there is nothing to extend; read its `words`"
        )
    by_name = {h["name"]: h for h in content["hypotheses"]}
    base = physics = physics_of(dict(config))
    table = read_measured(measured, strain_exponent=physics["observables"]["strain_exponent"])
    channels = list(Channels.parse(table["output"]))
    for name in content["named"]:
        hypothesis, found = REGISTRY[name].for_study(base), by_name[name]
        if isinstance(hypothesis, NoiseHypothesis):
            continue
        physics = hypothesis.extend(physics, found["estimate"], found["component"])
        channels = [
            Channel(c.quantity, c.place, round(hypothesis.load_fraction(c, found["estimate"]), 4))
            for c in channels
        ]
    frames = sorted({c.load_fraction for c in channels} - {1.0})
    loading = {**physics["loading"], "frames": frames}
    sections = {
        key: value
        for key, value in physics.items()
        if key in config and key not in ("geometry", "parameters")
    }
    geometry = {**config["geometry"], **physics["geometry"]}
    wanted = config["criticism"]["hypotheses"]
    if wanted != "all":
        # What is part of the model can no longer be asked.
        wanted = list(asked(wanted, {**physics, "loading": loading})) or "all"
    criticism = {**config["criticism"], "joint": {}, "extends": str(findings)}
    study = {
        **config,
        **sections,
        "loading": loading,
        "geometry": geometry,
        "study": f"{config['study']}_extended",
        "subjects": {subject: {"source": "file", "measured": str(corrected)}},
        "synthetic_subjects": {},
        "criticism": criticism | {"hypotheses": wanted},
    }
    table["output"] = [channel.name for channel in channels]
    table["load_fraction"] = [channel.load_fraction for channel in channels]
    write_measured(table, corrected)
    first = (
        f"# The study {config['study']} with what its criticism of {subject} named:\n"
        f"# {', '.join(content['named'])}\n"
    )
    Path(extended).write_text(first + yaml.safe_dump(study, sort_keys=False))


def compare_extended(
    subject: str, before: str | Path, after: str | Path, table: str | Path
) -> None:
    """Two criticisms of one subject, of the study and of the one that extends it, side by side
    (CSV): `what`, `before`, `after`.

    Misfit, error and coverage of each segment's prediction by the others, log predictive density,
    inferred noise, what is named, and every parameter with its sd.
    """
    both = [json.loads(Path(path).read_text()) for path in (before, after)]
    rows = [("misfit p-value", *(s["misfit"]["p_value"] for s in both))]
    rows += [("named", *(" + ".join(s["named"]) for s in both))]
    rows += [
        (what, *(s["gain"][key] for s in both))
        for what, key in (
            ("error of the strains", "rmse_before"),
            ("error of the volume (mL)", "rmse_volume_ml_before"),
            ("coverage of 95 % intervals", "coverage_before"),
            ("log predictive density", "elpd_before"),
        )
    ]
    for key, column in (("noise", "quantity"), ("theta", "parameter")):
        by_name = [{row[column]: row["before"] for row in s[key]} for s in both]
        for name in by_name[0]:
            values = [of.get(name) for of in by_name]
            if key == "noise":
                rows.append((f"noise {name}", *values))
            else:
                rows.append((name, *(v and v[0] for v in values)))
                rows.append((f"{name} sd", *(v and v[1] for v in values)))
    found = pd.DataFrame(rows, columns=["what", "before", "after"])
    found.insert(0, "subject", subject)
    found.to_csv(table, index=False)
