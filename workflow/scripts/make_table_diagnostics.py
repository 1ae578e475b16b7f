"""Write the table of convergence."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.diagnostics(
    tables.by_posteriors([*snakemake.input.shortlist, *snakemake.input.scenarios]),
    snakemake.input.subjects,
)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
