"""Write the table of emulator architectures."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.architectures(snakemake.input.fits)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
