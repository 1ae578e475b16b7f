"""Draw the widths of the HPD intervals."""

from regional_lv.figures import hpd_widths
from regional_lv.progress import start_log

start_log(snakemake.log[0])
hpd_widths.draw(
    snakemake.input.recovery,
    snakemake.input.noisy,
    snakemake.params.labels,
    snakemake.params.bounds,
    snakemake.output.png,
    snakemake.output.csv,
)
