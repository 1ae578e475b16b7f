"""Simulate one batch of ventricles with hidden effects."""

from regional_lv.criticism.hypotheses import asked
from regional_lv.criticism.planted import plant_batch, random_subjects
from regional_lv.progress import start_log

start_log(snakemake.log[0])
params = snakemake.params
size, batch = params.batch_size, int(snakemake.wildcards.batch)
entries = random_subjects(
    params.benchmark["planted"],
    params.benchmark["null"],
    params.seed,
    asked(params.hypotheses, params.physics),
    params.bounds,
)
subjects, truth = plant_batch(
    snakemake.input.mesh,
    params.physics,
    snakemake.input.predictor,
    entries[batch * size : (batch + 1) * size],
    params.benchmark["noise"],
    name=f"hidden effects batch {batch}",
)
subjects.to_parquet(snakemake.output.subjects, index=False)
truth.to_parquet(snakemake.output.truth, index=False)
