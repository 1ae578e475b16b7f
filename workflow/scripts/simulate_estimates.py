"""Pass estimates back through the simulator."""

from regional_lv.estimates.check import simulate_estimates
from regional_lv.progress import start_log

start_log(snakemake.log[0])
simulate_estimates(
    snakemake.input.mesh,
    snakemake.params.physics,
    snakemake.input.predictor,
    snakemake.input.estimates,
    snakemake.params.cases,
    snakemake.output[0],
)
