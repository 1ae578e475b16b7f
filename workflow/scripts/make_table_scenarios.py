"""Write the table of all simulated sets."""

from regional_lv.figures.verdicts import by_set
from regional_lv.progress import start_log
from regional_lv.tables.posteriors import scenarios
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
table = scenarios(
    by_set(snakemake.input.coverage),
    by_set(snakemake.input.areas),
    by_set(snakemake.input.recovery),
)
save(table, snakemake.output.csv, snakemake.output.tex)
