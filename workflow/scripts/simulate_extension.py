"""Simulate one hypothesis at one batch of anchors."""

from regional_lv.criticism.hypotheses import REGISTRY
from regional_lv.criticism.simulation import simulate_extension
from regional_lv.progress import start_log

start_log(snakemake.log[0])
hypothesis = snakemake.wildcards.hypothesis
simulate_extension(
    snakemake.input.mesh,
    snakemake.params.physics,
    snakemake.input.anchors,
    REGISTRY[hypothesis].for_study(snakemake.params.physics),
    snakemake.params.most,
    name=f"{hypothesis} batch {int(snakemake.wildcards.batch)}",
).to_parquet(snakemake.output[0], index=False)
