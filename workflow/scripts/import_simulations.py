"""Take one set of finished simulations from its tables."""

from regional_lv.progress import start_log
from regional_lv.simulation_tables import import_simulations

start_log(snakemake.log[0])
import_simulations(
    snakemake.wildcards.set,
    snakemake.input.inputs,
    snakemake.input.outputs,
    snakemake.params.own_test,
    snakemake.params.holdout,
    snakemake.params.rows,
    snakemake.params.bounds,
    snakemake.params.seed,
    snakemake.output[0],
)
