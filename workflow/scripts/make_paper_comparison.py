"""Write the paper's numbers beside this study's."""

from regional_lv import paper
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = paper.compare_study(
    snakemake.input.numbers,
    snakemake.input.reasons,
    snakemake.input.screened,
    snakemake.input.explained,
    snakemake.params.threshold,
    snakemake.input.coverage,
    snakemake.input.diagnostics,
    snakemake.input.zone_correlations,
    snakemake.input.volunteer,
    snakemake.input.estimates,
    snakemake.input.choice,
)
paper.save(table, snakemake.output.csv, snakemake.output.md)
