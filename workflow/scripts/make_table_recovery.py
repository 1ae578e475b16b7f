"""Write the table of accuracy on the test set."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.recovery(
    snakemake.input.recovery, snakemake.input.coverage, snakemake.input.diagnostics
)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
