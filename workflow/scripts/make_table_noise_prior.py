"""Write the table of the noise by its prior's scale."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.noise_prior(snakemake.input.noise_prior)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
