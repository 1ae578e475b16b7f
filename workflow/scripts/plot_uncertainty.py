"""Draw coverage and probability score of the shortlisted emulators."""

from regional_lv.figures import uncertainty
from regional_lv.figures.verdicts import by_emulator
from regional_lv.progress import start_log

start_log(snakemake.log[0])
uncertainty.draw(
    snakemake.input.coverage,
    snakemake.input.errors,
    list(by_emulator(snakemake.input.coverage)),
    snakemake.output.png,
    snakemake.output.csv,
)
