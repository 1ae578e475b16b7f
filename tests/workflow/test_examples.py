"""The examples of the configuration, each from the mesh to a posterior, as small as it can be."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from regional_lv import config as study_config
from regional_lv import registry
from regional_lv.inputs.space import Inputs
from regional_lv.measured import read_measured
from regional_lv.session import Study

EXAMPLES = Path(__file__).parents[2] / "config" / "examples"
SMOKE = EXAMPLES.parent / "smoke.yaml"
SUBJECT = "synthetic_lateral"

# Example, emulator, training simulations, parameters and channels that it has.
CASES = {
    "whole": ("gradient_gp", 12, 2, 52),
    "segments": ("gradient_gp", 36, 34, 52),
    "guccione": ("gradient_gp", 16, 10, 52),
    "three_loads": ("gradient_gp", 16, 10, 156),
    "torsion": ("exact_gp", 24, 10, 55),
    "plugin": ("exact_gp", 20, 2, 53),
}

SMALLER = {"plugin": {"parameters": {"zones": "whole"}}}
"""What is as large in the example as nothing of its own needs."""

DEEP = pytest.mark.test_all("a study of its own; `plugin` goes the same way")


@pytest.fixture(autouse=True)
def nothing_registered_stays():
    """What an example registers is gone after it: other tests count what the package has."""
    with registry.temporary():
        yield


def merged(first: dict, second: dict) -> dict:
    """As Snakemake puts two configuration files together."""
    both = first | second
    for key in first.keys() & second.keys():
        if isinstance(first[key], dict) and isinstance(second[key], dict):
            both[key] = merged(first[key], second[key])
    return both


def example(name: str, simulations: int) -> dict:
    smoke, own = (yaml.safe_load(p.read_text()) for p in (SMOKE, EXAMPLES / f"{name}.yaml"))
    small = {
        "design": {"natural": simulations - 4, "log": 4},
        "simulations": {"anchors": 8},
        "efficiency": {"sizes": [simulations], "most_with_sensitivities": simulations},
    }
    return merged(merged(smoke, own), small | SMALLER.get(name, {}))


@pytest.mark.parametrize(
    ("name", "emulator", "simulations", "parameters", "channels"),
    [
        pytest.param(name, *case, marks=[] if name == "plugin" else DEEP, id=name)
        for name, case in CASES.items()
    ],
)
def test_example(root, tmp_path, monkeypatch, name, emulator, simulations, parameters, channels):
    """Every simulation converges, its numbers are of the size and the names that the example asks
    for, and the posterior of a measured heart moves from the prior towards the truth."""
    monkeypatch.chdir(root)
    study = Study(example(name, simulations), tmp_path)
    assert (len(study.parameters), len(study.channels)) == (parameters, channels)
    study.make_heart()
    table = study.simulate()
    assert len(table) == simulations
    sizes = {len(row) for row in table["sensitivity"]}
    assert sizes == {parameters * channels}
    trained = study.train(emulator)
    measured = study.measure(SUBJECT)
    posterior = study.infer(measured, trained, SUBJECT).posterior["value"]
    assert tuple(posterior["input"].to_numpy()) == study.parameters.names
    draws = posterior.to_numpy().reshape(-1, parameters)
    assert (draws > study.parameters.lower).all() and (draws < study.parameters.upper).all()
    # The cavity's volume is measured to 2 mL: hearts of the posterior have it, those of the prior
    # any between stiff and soft.
    box = study.parameters.lower, study.parameters.upper
    prior = np.random.default_rng(0).uniform(*box, (len(draws), parameters))
    emulator_sd = trained.predict(torch.as_tensor(draws)).sd[:, 0].mean().item()
    after, before = (trained.predict_mean(torch.as_tensor(t))[:, 0].numpy() for t in (draws, prior))
    value = read_measured(measured, study.channels).set_index("output")["value"]["volume_ml"]
    assert after.std() < 0.6 * before.std()
    assert abs(after.mean() - value) < 3 * np.hypot(2.0, emulator_sd)
    if name == "plugin":
        quadratic = study.train("quadratic")
        at, y = (table[list(n)].to_numpy() for n in (study.parameters.names, study.channels.names))
        error = (quadratic.predict(torch.as_tensor(at)).mean.numpy() - y) / y.std(axis=0)
        assert np.sqrt(np.square(error).mean()) < 0.3
        # The cause from outside, as it is simulated: a tethered apex lets the cavity fill less.
        inputs = Inputs.from_config(study.config)
        tether = inputs[inputs.names.index("apical_tether")]
        free = study.outputs()
        study.physics = tether.act(study.physics, 0.1)
        held = study.outputs()
        assert held["volume_ml"] < free["volume_ml"] - 0.5
        assert held["sphericity"] > free["sphericity"]
        # And the load: without it the cavity fills more.
        loading = study.physics["loading"] | {"chest_pressure_mmhg": 0.0}
        study.physics = study.physics | {"loading": loading}
        assert study.outputs()["volume_ml"] > held["volume_ml"] + 0.5


@pytest.mark.parametrize("name", [path.stem for path in sorted(EXAMPLES.glob("*.yaml"))])
def test_examples_are_complete_configurations(root, monkeypatch, name):
    """On top of the small study, as their first line says."""
    monkeypatch.chdir(root)
    quick, own = (
        yaml.safe_load(p.read_text())
        for p in (SMOKE.with_name("study.yaml"), EXAMPLES / f"{name}.yaml")
    )
    assert study_config.load(merged(quick, own))["study"] == name


def test_the_page_on_extensions_shows_the_plugin():
    """Every line of its code, but for docstrings and what is left out (...), is run somewhere."""
    root = EXAMPLES.parents[1]
    page = (root / "docs" / "extending.md").read_text()
    tests = (
        root / "tests" / name
        for name in ("unit/test_emulators.py", "physics/test_example_plugin.py")
    )
    sources = EXAMPLES / "plugin.py", *tests
    plugin = {line.strip() for path in sources for line in path.read_text().splitlines()}
    blocks = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    lines = [line.strip() for block in blocks for line in block.splitlines() if "..." not in line]
    shown = [line for line in lines if not line.startswith('"""')]
    assert len(blocks) == 7 and len(shown) > 50
    assert [line for line in shown if line not in plugin] == []
