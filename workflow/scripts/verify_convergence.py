"""Measure errors and orders of convergence: the tube's, and the heart's on finer meshes."""

from regional_lv.progress import start_log
from regional_lv.verification import convergence

start_log(snakemake.log[0])
errors, orders = convergence.run(snakemake.params.physics, snakemake.input.hearts)
errors.to_csv(snakemake.output.errors, index=False)
orders.to_csv(snakemake.output.orders, index=False)
