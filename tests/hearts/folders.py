"""Folders of hearts as a user fills them in, and answers of hearts without an emulator."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
import yaml
from click.testing import CliRunner
from scipy import special

from regional_lv import data
from regional_lv.cli import main
from regional_lv.criticism.findings import write_findings
from regional_lv.errors import InputError
from regional_lv.inference.posteriors import write
from regional_lv.inputs.stiffness import StiffnessInputs
from tests.criticism.findings_example import example, summary
from tests.hearts.cohorts import covariances, posterior

NAMES = ("anna", "bert", "cleo", "dora", "emil", "fred")

PARAMETERS = StiffnessInputs()


def write_heart(folder: Path, measured=("", ""), scale: float = 1.0, **sections) -> Path:
    """A folder that `regional-lv new` wrote, filled in; `measured`: (text, replacement) in its
    measured file; scale: of its strains and its filling, so that hearts differ."""
    done = CliRunner().invoke(main, ["new", str(folder)])
    assert done.exit_code == 0, done.output
    config = yaml.safe_load((folder / "config.yaml").read_text())
    config |= {"loading": {"pressure_mmhg": 8}} | sections
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    lines = data.path("measured_template.csv").read_text().splitlines()
    at = lines[0].split(",").index("value")
    for i, line in enumerate(lines[1:], start=1):
        fields = line.split(",")
        fields[at] = f"{float(fields[at]) * scale:.4g}"
        lines[i] = ",".join(fields)
    (folder / "measured.csv").write_text("\n".join(lines).replace(*measured) + "\n")
    return folder


def write_cohort(folder: Path, names=NAMES, **sections) -> Path:
    """A folder with `hearts/<name>/` and the configuration of their cohort."""
    for k, name in enumerate(names):
        write_heart(folder / "hearts" / name, scale=1 + 0.01 * k)
    config = {"study": "group", "cohort": "hearts/*/"} | sections
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    return folder


def answer_as_known(config: Mapping, folder: Path, notes: Sequence[str] = ()) -> None:
    """In place of an answer: a posterior of hearts of a population (log stiffness normal about 0.2
    with an sd of 0.25), and models of which every second heart's holds a septal load.

    A heart that is called fred raises as broken software does, emil as bad input.
    """
    (name,) = config["subjects"]
    if name == "emil":
        raise InputError("emil: no answer; correct it")
    if name == "fred":
        raise ValueError("matrix is not positive definite")
    rng = np.random.default_rng([ord(c) for c in name])
    count = len(PARAMETERS)
    truth = 0.2 + 0.25 * rng.standard_normal(count)
    covariance = covariances(1, rng, zones=count // 2)[0]
    centre = truth + np.linalg.cholesky(covariance) @ rng.standard_normal(count)
    draws = posterior(centre, covariance, 400, int(rng.integers(1 << 30)))
    stiffness = [
        {
            **{"name": p, "unit": "1", "sources": {}, "shift_sd": 0.3},
            "averaged": summary(float(v.mean()), float(v.std())),
            "as_it_is": summary(float(v.mean()), float(v.std())),
        }
        for p, v in zip(PARAMETERS.names, draws.T, strict=True)
    ]
    folder.mkdir(parents=True)
    trusted = name != "dora"
    findings = example(subject=name, subjects=[name], stiffness=stiffness, trusted=trusted)
    write_findings(findings, folder / "findings.json")
    (folder / "page.html").write_text("\n".join([name, *notes]))
    load = 6.0 if name in ("anna", "cleo") else -3.0
    causes = ["septal_load", "focal_scar"]
    evidence, prior = np.array([0.0, load, 0.0, load]), np.array([1 / 3, 1 / 6, 1 / 6, 1 / 3])
    models = xr.Dataset(
        {
            "log_evidence": ("model", evidence),
            "log_prior": ("model", np.log(prior)),
            "holds": (("model", "cause"), np.array([[0, 0], [1, 0], [0, 1], [1, 1]], dtype=bool)),
        },
        {"cause": causes},
    )
    chosen = rng.choice(4, len(draws), p=special.softmax(evidence + np.log(prior)))
    inputs = {"input": list(PARAMETERS.names)}
    known = xr.Dataset(
        {
            "lower": ("input", PARAMETERS.lower),
            "upper": ("input", PARAMETERS.upper),
            "prior_probability": ("cause", [0.5, 0.5]),
        },
        inputs | {"cause": causes},
    )
    value = {
        "value": (("chain", "draw", "input"), draws[None]),
        "model_number": (("chain", "draw"), chosen[None]),
    }
    write(
        xr.DataTree.from_dict(
            {"posterior": xr.Dataset(value, inputs), "sample_stats": models, "constant_data": known}
        ),
        folder / "posterior.nc",
    )


def reasons(folder: Path) -> dict[str, str]:
    """Why hearts of a batch failed."""
    return json.loads((folder / "failed.json").read_text())
