"""Write the table of accuracy on the test set."""

from regional_lv.progress import start_log
from regional_lv.tables.posteriors import recovery
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
save(recovery(snakemake.input.coverage), snakemake.output.csv, snakemake.output.tex)
