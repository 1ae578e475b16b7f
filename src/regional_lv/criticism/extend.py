"""The model with the named causes switched on: a study of its own, and what it changes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
import yaml

from regional_lv.channels import Channel, Channels
from regional_lv.criticism.contract import Findings, read_findings
from regional_lv.criticism.hypotheses import REGISTRY, asked
from regional_lv.criticism.hypotheses.base import NoiseHypothesis, with_value
from regional_lv.criticism.study import read_known_theta
from regional_lv.errors import InputError
from regional_lv.measured import read_measured, write_measured
from regional_lv.mechanics.materials import material_from_config
from regional_lv.parameters import Parameterisation
from regional_lv.physics import physics_of


def write_extended(
    findings: str | Path,
    measured: Sequence[str | Path],
    known_theta: Sequence[str | Path],
    config: Mapping,
    subjects: Sequence[str],
    extended: str | Path,
    corrected: str | Path,
) -> None:
    """Write the configuration (YAML) of the study with the named causes of one subject, or of
    several together, each at its estimate, and a folder with their measured files as that study
    reads them.

    measured: files of `subjects`. known_theta: tables of their thetas, where these are known up to
    common factors on the reference material; the estimates of the factors become part of the
    reference, and a table of the thetas stands beside the measured files. config: the study's,
    complete. Of causes that say at which load a channel was observed, the measured files change;
    all others change keys of the simulator. Raises InputError if nothing is named.
    """
    content = read_findings(findings)
    if not content["named"]:
        raise InputError(
            f"{findings}: no cause is named, so that there is nothing to extend; read its `words`"
        )
    by_name = {h["name"]: h for h in content["hypotheses"]}
    base = physics = physics_of(dict(config))
    named = {name: REGISTRY[name].for_study(base) for name in content["named"]}
    if all(isinstance(hypothesis, NoiseHypothesis) for hypothesis in named.values()):
        raise InputError(
            f"{findings}: {', '.join(named)} is about the noise, so that the simulator stays as it "
            "is; look at the channels that the findings' `misfit` lists"
        )
    for name, hypothesis in named.items():
        found = by_name[name]
        physics = hypothesis.extend(physics, found["estimate"], found["component"])
    if known_theta:
        physics = with_value(physics, ("material", "reference"), _references(base, content))

    folder = Path(corrected)
    folder.mkdir(parents=True, exist_ok=True)
    exponent, frames = base["observables"]["strain_exponent"], set()
    for subject, path in zip(subjects, measured, strict=True):
        table = read_measured(path, strain_exponent=exponent)
        channels = [
            _as_observed(channel, named, by_name) for channel in Channels.parse(table["output"])
        ]
        table["output"] = [channel.name for channel in channels]
        table["load_fraction"] = [channel.load_fraction for channel in channels]
        frames |= {channel.load_fraction for channel in channels} - {1.0}
        write_measured(table, folder / f"{subject}.csv")
    loading = {**physics["loading"], "frames": sorted(frames)}

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
    joint: dict[str, dict] = {}
    if content["subject"] not in subjects:
        joint[content["subject"]] = {"subjects": list(subjects), "theta": None}
    if known_theta:
        names = Parameterisation.from_config(dict(config)).names
        theta = read_known_theta(known_theta, list(subjects), names).numpy()
        table = pd.DataFrame(theta, index=pd.Index(subjects, name="subject"), columns=names)
        table.to_csv(folder / "theta.csv")
        joint[content["subject"]]["theta"] = str(folder / "theta.csv")
    study = {
        **config,
        **sections,
        "loading": loading,
        "geometry": geometry,
        "study": f"{config['study']}_extended",
        "subjects": {
            name: {"source": "file", "measured": str(folder / f"{name}.csv")} for name in subjects
        },
        "synthetic_subjects": {},
        "criticism": {
            **config["criticism"],
            "joint": joint,
            "extends": str(findings),
            "hypotheses": wanted,
        },
    }
    first = (
        f"# The study {config['study']} with what its criticism of {content['subject']} named:\n"
        f"# {', '.join(content['named'])}\n"
    )
    Path(extended).write_text(first + yaml.safe_dump(study, sort_keys=False))


def _references(physics: Mapping, content: Findings) -> dict[str, float]:
    """References of the material's factors, times the common factors that were estimated."""
    references = dict(material_from_config(physics["material"]).references)
    for row in content["theta"]:
        references[row["parameter"].removeprefix("factor ")] *= row["after"][0]
    return references


def _as_observed(channel: Channel, named: Mapping, found: Mapping) -> Channel:
    """The channel at the load at which it was observed, by the `named` causes."""
    for name, hypothesis in named.items():
        fraction = hypothesis.load_fraction(channel, found[name]["estimate"])
        channel = Channel(channel.quantity, channel.place, round(fraction, 4))
    return channel


def compare_extended(
    subject: str, before: str | Path, after: str | Path, table: str | Path
) -> None:
    """Two criticisms of one subject, of the study and of the one that extends it, side by side
    (CSV): `what`, `before`, `after`.

    Misfit, error and coverage of each segment's prediction by the others, log predictive density,
    inferred noise, what is named, and every parameter with its sd.
    """
    both: list[Mapping] = [read_findings(path) for path in (before, after)]
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
