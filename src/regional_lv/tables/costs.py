"""Where the time of a study went: Snakemake's benchmark files, summed by step."""

from pathlib import Path

import pandas as pd

from regional_lv.errors import InputError


def costs(folder: str | Path) -> pd.DataFrame:
    """What the files (`*.tsv`) below `folder` say, the costliest step first, the sum last.

    Columns stage, step, jobs, wall_s and cpu_s (sums over the jobs, s) and max_memory_mb (MB, the
    largest job's resident memory). Snakemake looks at a job every 30 s: what it did after the last
    look is missing from cpu_s and max_memory_mb. Each file is of one job and of the last time that
    it ran; batches of one step count as its jobs. Steps without a benchmark take seconds and are
    left out.

    Raises InputError if there are no files.
    """
    files = sorted(Path(folder).rglob("*.tsv"))
    if not files:
        raise InputError(f"{folder}: no benchmarks (*.tsv); they come with the steps of a study")
    jobs = pd.concat([pd.read_csv(file, sep="\t") for file in files], ignore_index=True)
    jobs["step"] = [_step(file.relative_to(folder)) for file in files]
    jobs["stage"] = jobs["step"].str.split("/").str[0]
    sums = jobs.groupby(["stage", "step"], as_index=False).agg(
        jobs=("s", "size"),
        wall_s=("s", "sum"),
        cpu_s=("cpu_time", "sum"),
        max_memory_mb=("max_rss", "max"),
    )
    sums = sums.sort_values("cpu_s", ascending=False)
    total = {
        "stage": "all",
        "step": "all",
        **sums[["jobs", "wall_s", "cpu_s"]].sum(),
        "max_memory_mb": sums["max_memory_mb"].max(),
    }
    table = pd.concat([sums, pd.DataFrame([total])], ignore_index=True)
    return table.astype({"jobs": int})


def tabulate_costs(table: str | Path) -> None:
    """Write `costs` of the folder in which the table is to lie (CSV)."""
    costs(Path(table).parent).to_csv(table, index=False, float_format="%.1f")


def _step(file: Path) -> str:
    """`emulators/dnn` of emulators/dnn.tsv, `simulations/train` of its batches."""
    name = file.parent if file.name.startswith("batch-") else file.with_suffix("")
    return name.as_posix()
