"""Write the table of emulator architectures."""

from regional_lv.progress import start_log
from regional_lv.tables.emulators import architectures
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
table = architectures(snakemake.input.fits)
save(table, snakemake.output.csv, snakemake.output.tex)
