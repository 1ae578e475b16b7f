"""Simulate one batch of a design."""

import pandas as pd

from regional_lv.progress import start_log
from regional_lv.simulations import simulate_batch

start_log(snakemake.log[0])
size, batch = snakemake.params.batch_size, int(snakemake.wildcards.batch)
design = pd.read_parquet(snakemake.input.design).iloc[batch * size : (batch + 1) * size]
simulate_batch(
    snakemake.input.mesh,
    snakemake.params.physics,
    snakemake.input.predictor,
    design,
    name=f"{snakemake.wildcards.set} batch {batch}",
).to_parquet(snakemake.output[0], index=False)
