"""Solve two problems of the cardiac mechanics benchmark of Land et al. (2015)."""

from regional_lv.progress import start_log
from regional_lv.verification import land

start_log(snakemake.log[0])
land.run(snakemake.params.solver).to_csv(snakemake.output[0], index=False)
