"""Solve the start of every simulation."""

import json
from pathlib import Path

from regional_lv.progress import start_log
from regional_lv.simulations import solve_baseline

start_log(snakemake.log[0])
summary = solve_baseline(
    snakemake.input.mesh, snakemake.params.physics, snakemake.params.bounds, snakemake.output.start
)
Path(snakemake.output.summary).write_text(json.dumps(summary, indent=2) + "\n")
