"""Convergence, recovery and coverage of the test set's posteriors."""

from regional_lv.inference.diagnostics import summarise_posteriors
from regional_lv.progress import start_log

start_log(snakemake.log[0])
summarise_posteriors(
    snakemake.input.posteriors,
    snakemake.output.diagnostics,
    snakemake.output.recovery,
    snakemake.output.coverage,
    snakemake.output.map_mse,
)
