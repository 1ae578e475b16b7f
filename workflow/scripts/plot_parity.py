"""Draw the emulator against the simulator."""

from regional_lv.figures import parity
from regional_lv.progress import start_log

start_log(snakemake.log[0])
parity.draw(
    snakemake.input.predictions,
    snakemake.input.choice,
    snakemake.output.png,
    snakemake.output.csv,
)
