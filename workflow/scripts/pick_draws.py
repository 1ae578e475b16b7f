"""Posterior draws as a design for the simulator."""

from regional_lv.inference.resimulation import pick_draws
from regional_lv.progress import start_log

start_log(snakemake.log[0])
pick_draws(
    snakemake.input.posteriors,
    snakemake.params.cases,
    snakemake.params.draws,
    snakemake.params.seed,
    snakemake.output[0],
)
