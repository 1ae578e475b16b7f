"""Write the published volunteer in the tidy form."""

from regional_lv.measured import published_volunteer, write_measured
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = published_volunteer(
    snakemake.input.case,
    snakemake.input.get("slices"),
    snakemake.params.frame,
    snakemake.params.slices,
)
write_measured(table, snakemake.output[0])
