"""Batches of a design, from the anchors on."""

import numpy as np
import pandas as pd
import pytest

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.mechanics.predictor import fit_predictor
from regional_lv.simulation.batches import (
    make_runner,
    run_all,
    simulate_batch,
    solve_anchors,
    solve_baseline,
)
from regional_lv.simulation.sobol import make_design

SIZES = {"natural": 4, "log": 3, "test": 1, "lower": 0.5, "upper": 2.0}


@pytest.fixture(scope="module")
def made(small_mesh, physics, tmp_path_factory):
    """Folder with a design, four of its rows solved as anchors, and all of it simulated from them,
    with the anchors and without."""
    folder = tmp_path_factory.mktemp("batches")
    files = {name: folder / f"{name}.npz" for name in ("start", "fields", "predictor")}
    design, anchors = folder / "design.parquet", folder / "anchors.parquet"
    parameters = StiffnessInputs(bounds=(SIZES["lower"], SIZES["upper"]))
    make_design(SIZES, parameters, 3)["train"].to_parquet(design, index=False)
    solve_baseline(small_mesh, physics, files["start"], folder / "baseline.json")
    given = (small_mesh, files["start"], design, physics, 4, 1, "0000")
    solve_anchors(*given, files["fields"], anchors)
    fit_predictor([files["fields"]], physics, files["predictor"])
    given = (small_mesh, files["predictor"], design, physics, 7, "0000", "train")
    simulate_batch(*given, folder / "with.parquet", [anchors])
    simulate_batch(*given, folder / "without.parquet")
    return folder


def test_a_ventricle_that_cannot_be_inflated_is_said_so(small_mesh, physics, tmp_path):
    one_step = physics["solver"] | {"min_load_fraction": 0.5, "first_load_fraction": 0.5}
    given = physics | {"solver": one_step | {"max_newton_steps": 1}}
    with pytest.raises(InputError, match=r"mesh.vtu: this ventricle cannot be inflated .*units"):
        solve_baseline(small_mesh, given, tmp_path / "start.npz", tmp_path / "baseline.json")


def test_a_batch_without_an_anchor_says_so(made, small_mesh, physics):
    """At a pressure that no step can bring to an end."""
    solver = physics["solver"] | {"min_load_fraction": 0.5, "first_load_fraction": 0.5}
    solver |= {"max_newton_steps": 1}
    given = (small_mesh, made / "start.npz", made / "design.parquet", physics | {"solver": solver})
    with pytest.raises(InputError, match=r"none of the 4 anchors of batch 0000 converged.*narrow"):
        solve_anchors(*given, 4, 1, "0000", made / "none.npz", made / "none.parquet")


def test_anchors_are_taken_over_as_they_are(made):
    """Two of the natural rows and two of the log ones are anchors; the order is the design's."""
    table = pd.read_parquet(made / "with.parquet")
    assert table["sample"].tolist() == list(range(7))
    anchors = pd.read_parquet(made / "anchors.parquet")
    assert sorted(anchors["sample"]) == [0, 1, 4, 5]
    taken = table[table["sample"].isin(anchors["sample"])].reset_index(drop=True)
    pd.testing.assert_frame_equal(taken, anchors.sort_values("sample").reset_index(drop=True))


def test_an_equilibrium_does_not_depend_on_the_way_to_it(made):
    both = [pd.read_parquet(made / f"{name}.parquet") for name in ("with", "without")]
    assert (both[0]["status"] == "converged").all()
    channels = Channels.of()
    values = [table[list(channels.names)].to_numpy() for table in both]
    np.testing.assert_allclose(*values, rtol=1e-5, atol=1e-6)
    slopes = [np.stack(t["sensitivity"]).reshape(7, len(channels), -1) for t in both]
    difference = np.abs(slopes[0] - slopes[1])
    assert difference[:, channels.of_quantity("volume")].max() < 2e-3  # mL, of up to 80
    assert difference[:, channels.is_strain].max() < 1e-4  # of up to 0.84


def test_a_shape_whose_neighbour_is_none_fails_alone(made, small_mesh, physics, monkeypatch):
    """Derivatives are taken at shapes beside it, which may have no smooth wall."""
    runner = make_runner(small_mesh, physics, made / "predictor.npz")
    differentiated = runner.solver.simulator.differentiated

    def sometimes(state, fraction):
        if state.theta[0] == 1.5:
            raise InputError("segment table: no smooth surface")
        return differentiated(state, fraction)

    monkeypatch.setattr(runner.solver.simulator, "differentiated", sometimes)
    thetas = np.ones((3, 10))
    thetas[1, 0] = 1.5
    results = run_all(runner, thetas, "three")
    assert [r.status for r in results] == ["converged", "failed", "converged"]
    assert "no smooth surface" in results[1].reason and results[1].sensitivity is None
