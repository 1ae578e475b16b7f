"""Draw the parameter errors of all emulators, sample by sample."""

from regional_lv.figures import per_sample_mse
from regional_lv.progress import start_log

start_log(snakemake.log[0])
per_sample_mse.draw(
    snakemake.params.names,
    snakemake.input.estimates,
    snakemake.input.shortlist,
    snakemake.output.png,
    snakemake.output.csv,
)
