"""Write the table of emulators that could have been chosen."""

from regional_lv.progress import start_log
from regional_lv.tables.posteriors import choice
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
save(choice(snakemake.input.choice), snakemake.output.csv, snakemake.output.tex)
