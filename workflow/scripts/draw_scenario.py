"""Draw the ventricles of one disease scenario."""

from regional_lv.design import draw_scenario
from regional_lv.progress import start_log

start_log(snakemake.log[0])
draw_scenario(
    snakemake.wildcards.scenario,
    snakemake.params.scenario,
    snakemake.params.healthy,
    *snakemake.params.bounds,
    snakemake.params.seed,
).to_parquet(snakemake.output[0], index=False)
