"""Figures and tables of a subject by an emulator of the stiffness alone: they carry their numbers,
and they hide no failure."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from regional_lv.channels import Channels
from regional_lv.criticism.case_posterior import SOURCES
from regional_lv.errors import InputError
from regional_lv.inference.posteriors import write
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper import case_posterior
from regional_lv.paper.plots import bullseye_posterior, posterior_predictive, traces
from tests.drawn import read

FAILED = "failed: R-hat 1.6 of C_a_septal above 1.01"
PARAMETERS = StiffnessInputs()
OBSERVED = [o for o in Channels.of().names if not o.startswith("longitudinal") and "17" not in o]


@pytest.fixture
def subject(tmp_path):
    """A posterior with noise scales, its verdict, its truth: (nc, diagnostics, truth)."""

    def make(verdict="passed", inside=True):
        rng = np.random.default_rng(0)
        truth = dict(zip(PARAMETERS.names, np.linspace(0.5, 2.0, 10), strict=True))
        theta = np.array(list(truth.values())) * np.exp(0.1 * rng.normal(size=(2, 50, 1, 10)))
        predicted = 0.1 + 0.01 * rng.normal(size=(2, 50, 1, len(OBSERVED)))
        observed = np.full((1, len(OBSERVED)), 0.1)
        observed[0, 3] += 0.0 if inside else 1.0
        case = {"case": ["heart"]}
        write(
            xr.DataTree.from_dict(
                {
                    "posterior": xr.Dataset(
                        {
                            "theta": (("chain", "draw", "case", "parameter"), theta),
                            "sigma": (("chain", "draw", "case", "direction"), 0.3 * theta[..., :2]),
                        },
                        {
                            **case,
                            "parameter": list(PARAMETERS.names),
                            "direction": ["circumferential", "radial"],
                        },
                    ),
                    "observed_data": xr.Dataset(
                        {"y": (("case", "output"), observed)}, {**case, "output": OBSERVED}
                    ),
                    "posterior_predictive": xr.Dataset(
                        {"y": (("chain", "draw", "case", "output"), predicted)},
                        {**case, "output": OBSERVED},
                    ),
                }
            ),
            tmp_path / "heart.nc",
        )
        names = [*PARAMETERS.names, "sigma_circumferential", "sigma_radial"]
        pd.DataFrame(
            {
                "case": "heart",
                "parameter": names,
                "rhat": 1.0,
                "ess_bulk": 900.0,
                "ess_tail": 800.0,
                "divergences": 1,
                "passed": verdict == "passed",
                "verdict": verdict,
                "seconds": 1.0,
            }
        ).to_csv(tmp_path / "diagnostics.csv", index=False)
        (tmp_path / "truth.json").write_text(json.dumps({"theta": truth}))
        return tmp_path / "heart.nc", tmp_path / "diagnostics.csv", tmp_path / "truth.json"

    return make


def test_bullseye_posterior(subject, paths):
    nc, diagnostics, truth = subject()
    bullseye_posterior.draw(nc, diagnostics, "synthetic", PARAMETERS, *paths, truth=truth)
    drawn = read(paths).set_index(["parameter", "item"])["value"].sort_index()
    draws = case_posterior.read(nc, diagnostics).draws
    for name, values in draws.items():
        assert drawn[name, "median"].item() == pytest.approx(np.median(values))
        inside = (values >= drawn[name, "lower95"].item()) & (
            values <= drawn[name, "upper95"].item()
        )
        assert inside.mean() == pytest.approx(0.95, abs=0.015)
    known = json.loads(truth.read_text())["theta"]
    for name in PARAMETERS.names:
        assert drawn[name, "truth"].item() == pytest.approx(known[name])


@pytest.mark.parametrize(("inside", "outside"), [(True, 0), (False, 1)])
def test_posterior_predictive(subject, paths, figures, inside, outside):
    nc, diagnostics, _ = subject(inside=inside)
    posterior_predictive.draw(nc, diagnostics, "file", *paths)
    drawn = read(paths)
    observed = drawn[drawn["item"] == "observed"].set_index("output")
    assert list(observed.index.sort_values()) == sorted(OBSERVED)
    assert (observed["inside"].astype(str) == "False").sum() == outside
    assert f"{outside} of {len(OBSERVED)} observations outside" in figures[0].get_suptitle()


def test_traces(subject, paths):
    nc, diagnostics, truth = subject()
    traces.draw(nc, diagnostics, "synthetic", *paths, truth=truth)
    drawn = read(paths)
    draws = case_posterior.read(nc, diagnostics).draws
    for name, values in draws.items():
        rows = drawn[(drawn["parameter"] == name) & (drawn["item"] == "draw")]
        assert rows["y"].to_numpy() == pytest.approx(values.ravel())
    first = drawn[(drawn["item"] == "autocorrelation") & (drawn["x"] == 0)]
    assert first["y"].to_numpy() == pytest.approx(1.0)


def draw_subject(module, files, source, paths):
    nc, diagnostics, _ = files
    known = [PARAMETERS] if module is bullseye_posterior else []
    module.draw(nc, diagnostics, source, *known, *paths)


SUBJECT_FIGURES = [bullseye_posterior, posterior_predictive, traces]


@pytest.mark.parametrize("module", SUBJECT_FIGURES)
def test_failed_check_is_in_the_title(module, subject, paths, figures):
    draw_subject(module, subject(FAILED), "file", paths)
    title = " ".join(figures[0].get_suptitle().split())
    assert "POSTERIOR FAILED ITS CONVERGENCE CHECK (R-hat 1.6 of C_a_septal above 1.01)" in title
    assert set(read(paths)["verdict"]) == {FAILED}


@pytest.mark.parametrize("module", SUBJECT_FIGURES)
@pytest.mark.parametrize("source", ["synthetic", "file"])
def test_title_says_where_the_data_come_from(module, source, subject, paths, figures):
    draw_subject(module, subject(), source, paths)
    title = figures[0].get_suptitle()
    assert SOURCES[source] in title
    assert ("synthetic" in title) == (source == "synthetic")
    assert "FAILED" not in title


def test_unknown_case_and_missing_verdict_are_named(subject, tmp_path):
    nc, diagnostics, _ = subject()
    with pytest.raises(InputError, match="no case 'other'"):
        case_posterior.read(nc, diagnostics, case="other")
    empty = pd.read_csv(diagnostics).iloc[:0]
    empty.to_csv(tmp_path / "empty.csv", index=False)
    with pytest.raises(InputError, match="no row for case 'heart'"):
        case_posterior.read(nc, tmp_path / "empty.csv")
