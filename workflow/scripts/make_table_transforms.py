"""Write what the input transform does to the estimates of every emulator."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.transforms(snakemake.input.transforms)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
