"""Draw what the posteriors of the test set recover."""

from regional_lv.figures import recovery
from regional_lv.progress import start_log

start_log(snakemake.log[0])
recovery.draw(
    snakemake.input.recovery,
    snakemake.input.coverage,
    snakemake.input.diagnostics,
    snakemake.input.choice,
    snakemake.output.png,
    snakemake.output.csv,
)
