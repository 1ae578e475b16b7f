"""Write the table of posterior contraction."""

from regional_lv.figures.verdicts import by_emulator
from regional_lv.progress import start_log
from regional_lv.tables.posteriors import variance_ratios
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
coverages = {name: paths[0] for name, paths in by_emulator(snakemake.input.coverage).items()}
save(variance_ratios(coverages), snakemake.output.csv, snakemake.output.tex)
