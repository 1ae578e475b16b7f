"""Write the table of all simulated sets."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.scenarios(
    tables.by_set(snakemake.input.coverage),
    tables.by_set(snakemake.input.areas),
    tables.by_set(snakemake.input.recovery),
)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
