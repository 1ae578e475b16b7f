"""Write the table of the subjects' stiffness."""

from regional_lv.progress import start_log
from regional_lv.tables.subjects import subjects
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
table = subjects(snakemake.input.posteriors, snakemake.input.diagnostics, snakemake.params.sources)
save(table, snakemake.output.csv, snakemake.output.tex)
