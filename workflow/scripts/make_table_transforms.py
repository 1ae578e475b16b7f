"""Write what the input transform does to the estimates of every emulator."""

from regional_lv.progress import start_log
from regional_lv.tables.emulators import transforms
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
table = transforms(snakemake.input.transforms)
save(table, snakemake.output.csv, snakemake.output.tex)
