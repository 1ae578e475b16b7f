"""Make the measured file of a synthetic subject, and its truth beside."""

from regional_lv.measured import write_measured, write_truth
from regional_lv.progress import start_log
from regional_lv.subjects import simulate_subject

start_log(snakemake.log[0])
measured, truth = simulate_subject(
    snakemake.wildcards.subject,
    snakemake.params.subject,
    snakemake.input.mesh,
    snakemake.params.physics,
    snakemake.input.predictor,
    snakemake.params.seed,
)
write_measured(measured, snakemake.output.measured)
write_truth(snakemake.output.truth, **truth)
