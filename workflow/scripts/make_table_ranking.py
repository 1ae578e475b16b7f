"""Write the ranking of the emulators."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.ranking(snakemake.input.ranking)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
