"""Write the table of convergence."""

from regional_lv.figures.verdicts import by_posteriors
from regional_lv.progress import start_log
from regional_lv.tables.posteriors import diagnostics
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
table = diagnostics(
    by_posteriors([*snakemake.input.shortlist, *snakemake.input.scenarios]),
    snakemake.input.subjects,
)
save(table, snakemake.output.csv, snakemake.output.tex)
