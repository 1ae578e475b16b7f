"""Benchmark files summed by step."""

import pytest

from regional_lv.errors import InputError
from regional_lv.tables.costs import costs


def test_batches_are_jobs_of_one_step(tmp_path):
    written = {
        "fit_predictor": (2.0, 400.0, 1.5),
        "simulations/train/batch-0000": (90.0, 500.0, 80.0),
        "simulations/train/batch-0001": (70.0, 300.0, 60.0),
        "emulators/dnn": (10.0, 600.0, "NA"),  # Snakemake's word for a job too short to be watched
    }
    for name, values in written.items():
        file = tmp_path / f"{name}.tsv"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("s\tmax_rss\tcpu_time\n" + "\t".join(map(str, values)) + "\n")
    table = costs(tmp_path)
    assert list(table["step"]) == ["simulations/train", "fit_predictor", "emulators/dnn", "all"]
    assert list(table["stage"]) == ["simulations", "fit_predictor", "emulators", "all"]
    assert list(table["jobs"]) == [2, 1, 1, 4]
    assert list(table["wall_s"]) == [160.0, 2.0, 10.0, 172.0]
    assert table["cpu_s"].iloc[-1] == 141.5
    assert list(table["max_memory_mb"]) == [500.0, 400.0, 600.0, 600.0]


def test_no_benchmarks(tmp_path):
    with pytest.raises(InputError, match="no benchmarks"):
        costs(tmp_path)
