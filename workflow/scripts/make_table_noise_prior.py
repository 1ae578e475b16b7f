"""Write the table of the noise by its prior's scale."""

from regional_lv.progress import start_log
from regional_lv.tables.subjects import noise_prior
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
table = noise_prior(snakemake.input.noise_prior)
save(table, snakemake.output.csv, snakemake.output.tex)
