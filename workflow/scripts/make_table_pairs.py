"""Write the tests of single- against multi-output emulators."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.pairs(snakemake.input.pairs)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
