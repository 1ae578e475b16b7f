"""Write a published simulation as a measured file, and its theta apart."""

from regional_lv.measured import published_simulation, write_measured
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table, theta = published_simulation(
    snakemake.input.inputs, snakemake.input.outputs, snakemake.params.row
)
write_measured(table, snakemake.output.measured)
theta.to_frame(snakemake.wildcards.subject).T.to_csv(snakemake.output.theta, index_label="subject")
