"""Write errors against the number of simulations."""

from regional_lv.progress import start_log
from regional_lv.tables.emulators import sample_efficiency
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
table = sample_efficiency(snakemake.input.curves)
save(table, snakemake.output.csv, snakemake.output.tex)
