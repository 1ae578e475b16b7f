"""Write the tests of single- against multi-output emulators."""

from regional_lv.progress import start_log
from regional_lv.tables.emulators import pairs
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
table = pairs(snakemake.input.pairs)
save(table, snakemake.output.csv, snakemake.output.tex)
