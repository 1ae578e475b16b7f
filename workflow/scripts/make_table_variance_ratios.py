"""Write the table of posterior contraction."""

from regional_lv import tables
from regional_lv.figures.posterior import by_emulator
from regional_lv.progress import start_log

start_log(snakemake.log[0])
coverages = {name: paths[0] for name, paths in by_emulator(snakemake.input.coverage).items()}
tables.save(tables.variance_ratios(coverages), snakemake.output.csv, snakemake.output.tex)
