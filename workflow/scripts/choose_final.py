"""Choose the final emulator by the stated rule."""

from pathlib import Path

from regional_lv.inference.choice import choose_final
from regional_lv.progress import start_log

start_log(snakemake.log[0])
choose_final(
    [Path(file).stem for file in snakemake.input.emulators],
    snakemake.input.emulators,
    snakemake.input.coverages,
    snakemake.params.wanted,
    snakemake.output.emulator,
    snakemake.output.report,
)
