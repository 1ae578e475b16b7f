"""Merge the batches of a set and separate what did not converge."""

from regional_lv.progress import start_log
from regional_lv.screening import screen

start_log(snakemake.log[0])
kept, excluded, summary = screen(snakemake.input.batches, *snakemake.params.bounds)
kept.to_parquet(snakemake.output.kept, index=False)
excluded.to_csv(snakemake.output.excluded, index=False)
summary.to_csv(snakemake.output.summary, index=False)
