"""Write the table of the subjects' stiffness."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.subjects(
    snakemake.input.posteriors, snakemake.input.diagnostics, snakemake.params.sources
)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
