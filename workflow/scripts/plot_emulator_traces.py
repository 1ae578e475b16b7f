"""Draw one test case under every shortlisted emulator."""

from regional_lv.figures import emulator_traces
from regional_lv.figures.verdicts import by_emulator
from regional_lv.progress import start_log

start_log(snakemake.log[0])
emulator_traces.draw(
    snakemake.input.errors,
    by_emulator(snakemake.input.posteriors),
    {name: paths[0] for name, paths in by_emulator(snakemake.input.diagnostics).items()},
    snakemake.params.parameters,
    snakemake.output.png,
    snakemake.output.csv,
)
