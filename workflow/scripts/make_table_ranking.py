"""Write the ranking of the emulators."""

from regional_lv.progress import start_log
from regional_lv.tables.emulators import ranking
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
table = ranking(snakemake.input.ranking)
save(table, snakemake.output.csv, snakemake.output.tex)
