"""Screening: what failed is left out, listed with its reason and placed in the box."""

import numpy as np
import pandas as pd
import pytest

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.mechanics.continuation import Simulation
from regional_lv.simulation.batches import tabulate
from regional_lv.simulation.screening import screen, screen_simulations
from regional_lv.simulation.sobol import make_design

PARAMETERS, CHANNELS = StiffnessInputs(), Channels.of()
DESIGN = {"natural": 6, "log": 2, "test": 2}


def batches(folder, failing):
    train = make_design(DESIGN, PARAMETERS, seed=1)["train"]
    paths = []
    for start in (4, 0):  # the order of batches must not matter
        rows = train.iloc[start : start + 4]
        results = []
        for sample in rows["sample"]:
            theta = rows.loc[sample, list(PARAMETERS.names)].to_numpy(dtype=float)
            if sample in failing:
                took = "at 3.000 mmHg: no way", 3.0, 40, 2.0
                results.append(Simulation(theta, "failed", np.full(52, np.nan), *took))
            else:
                values, slopes = np.full(52, float(sample)), np.zeros((52, 10))
                results.append(Simulation(theta, "converged", values, "", 8.0, 5, 0.5, slopes))
        path = folder / f"batch-{start}.parquet"
        tabulate(rows, results, CHANNELS).to_parquet(path, index=False)
        paths.append(path)
    return paths


def test_failures_are_listed_with_reason_and_place(tmp_path):
    kept, excluded, summary = screen(batches(tmp_path, failing={5}), PARAMETERS, CHANNELS)
    assert kept["sample"].tolist() == [0, 1, 2, 3, 4, 6, 7]
    assert kept["volume_ml"].tolist() == [0, 1, 2, 3, 4, 6, 7]
    assert kept["sensitivity"].map(len).eq(520).all()
    (row,) = excluded.to_dict("records")
    assert row["sample"] == 5 and row["last_pressure_mmhg"] == 3.0
    assert "no way" in row["reason"]
    expected = np.log(row["C_b_septal"] / 0.1) / np.log(50)
    assert row["place_C_b_septal"] == pytest.approx(expected)
    assert summary.loc[0, "converged"] == 7 and summary.loc[0, "simulations"] == 8


def test_nothing_converged_is_an_error_with_a_remedy(tmp_path):
    with pytest.raises(InputError, match=r"none of 8 simulations converged.*material"):
        screen(batches(tmp_path, failing=set(range(8))), PARAMETERS, CHANNELS, steepest=5.0)


def test_not_finite_outputs_do_not_pass(tmp_path):
    paths = batches(tmp_path, failing=set())
    table = pd.read_parquet(paths[0])
    table.loc[0, "radial_03"] = np.nan
    table.to_parquet(paths[0], index=False)
    kept, excluded, _ = screen(paths, PARAMETERS, CHANNELS)
    assert len(kept) == 7 and excluded["reason"].tolist() == ["an output is not finite"]


def test_tables_are_written(tmp_path):
    files = [tmp_path / name for name in ("kept.parquet", "excluded.csv", "summary.csv")]
    screen_simulations(batches(tmp_path, failing={2}), PARAMETERS, CHANNELS, *files)
    assert len(pd.read_parquet(files[0])) == 7 and len(pd.read_csv(files[1])) == 1
    summary = pd.read_csv(files[2])
    assert summary.loc[0, "volume_ml_max"] == 7
    assert not [name for name in summary if "radial" in name]


def test_what_is_about_to_become_unstable_is_left_out(tmp_path):
    """By its derivatives, whatever the unit of an output; it is listed among the failures."""
    paths = batches(tmp_path, failing={5})
    rng = np.random.default_rng(2)
    for path in paths:
        table = pd.read_parquet(path)
        for row, sample in enumerate(table["sample"]):
            if sample != 5:
                slopes = (
                    rng.normal(size=(52, 10)) * np.where(np.arange(52) == 0, 50.0, 0.1)[:, None]
                )
                slopes[7] = 0.0  # an output that nothing changes
                size = {3: 30.0, 6: 2.0}.get(sample, 1.0)
                table.at[row, "sensitivity"] = (
                    size * slopes / table.loc[row, "C_a_apical"]
                ).ravel()
        table.to_parquet(path, index=False)
    kept, excluded, summary = screen(paths, PARAMETERS, CHANNELS, steepest=8.0)
    assert kept["sample"].tolist() == [0, 1, 2, 4, 6, 7]
    assert excluded["sample"].tolist() == [3, 5]
    assert "limit of stability" in excluded["reason"][0] and "no way" in excluded["reason"][1]
    assert summary.loc[0, "converged"] == 6
    assert len(screen(paths, PARAMETERS, CHANNELS)[0]) == 7
