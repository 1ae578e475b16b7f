"""Rank the emulators and choose the shortlist."""

from pathlib import Path

from regional_lv.estimates.ranking import rank_emulators
from regional_lv.progress import start_log

start_log(snakemake.log[0])
rank_emulators(
    snakemake.params.names,
    Path(snakemake.output.ranking).parent,
    Path(snakemake.input.fits[0]).parents[1],
    snakemake.input.train,
    snakemake.input.test,
    snakemake.input.paper,
    snakemake.params.size,
    snakemake.params.estimator,
    ranking=snakemake.output.ranking,
    pairs=snakemake.output.pairs,
    shortlist=snakemake.output.shortlist,
)
