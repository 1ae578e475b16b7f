"""Copy the chosen emulator's posteriors of the test set to where the final ones are expected."""

from regional_lv.inference.choice import adopt
from regional_lv.progress import start_log

start_log(snakemake.log[0])
adopt(
    snakemake.input.report,
    [*snakemake.input.posteriors, *snakemake.input.tables],
    snakemake.output,
)
