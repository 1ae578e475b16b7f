"""Convergence, recovery, coverage and correlations of a set of posteriors."""

from pathlib import Path

from regional_lv.inference.summaries import summarise_posteriors
from regional_lv.progress import start_log

start_log(snakemake.log[0])
summarise_posteriors(snakemake.input.posteriors, Path(snakemake.output[0]).parent)
