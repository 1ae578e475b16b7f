"""Probabilities that the zones of a scenario are stiffer than baseline."""

from regional_lv.inference.told_apart import tell_zones_apart
from regional_lv.progress import start_log

start_log(snakemake.log[0])
tell_zones_apart(
    snakemake.input.posteriors,
    snakemake.params.healthy,
    snakemake.output.told_apart,
    snakemake.output.by_zone,
)
