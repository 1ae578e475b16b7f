"""Write the table of emulators that could have been chosen."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
tables.save(tables.choice(snakemake.input.choice), snakemake.output.csv, snakemake.output.tex)
