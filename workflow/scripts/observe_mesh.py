"""Observables of one mesh of the mesh study."""

from regional_lv.progress import start_log
from regional_lv.verification.mesh_study import observe

start_log(snakemake.log[0])
observe(
    snakemake.input.mesh,
    snakemake.params.physics,
    snakemake.params.design,
    snakemake.params.seed,
    name=snakemake.wildcards.mesh,
).to_parquet(snakemake.output[0], index=False)
