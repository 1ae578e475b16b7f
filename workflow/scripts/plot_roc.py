"""Draw how well a stiffened zone is told from baseline."""

from regional_lv.figures import roc
from regional_lv.progress import start_log

start_log(snakemake.log[0])
roc.draw(
    snakemake.input.curves,
    snakemake.input.areas,
    snakemake.input.recovery,
    snakemake.params.labels,
    snakemake.output.png,
    snakemake.output.csv,
)
