"""Draw the rank histograms of simulation-based calibration."""

from regional_lv.figures import sbc
from regional_lv.progress import start_log

start_log(snakemake.log[0])
sbc.draw(
    snakemake.input.ranks,
    snakemake.input.tests,
    snakemake.input.choice,
    snakemake.output.png,
    snakemake.output.csv,
)
