"""Solve one batch of anchors."""

import pandas as pd

from regional_lv.progress import start_log
from regional_lv.simulations import anchors_of, solve_anchors

start_log(snakemake.log[0])
batch = int(snakemake.wildcards.batch)
anchors = anchors_of(pd.read_parquet(snakemake.input.design), snakemake.params.anchors)
solve_anchors(
    snakemake.input.mesh,
    snakemake.params.physics,
    snakemake.input.start,
    anchors[batch :: snakemake.params.batches],
    snakemake.output[0],
    name=f"anchors batch {batch}",
)
