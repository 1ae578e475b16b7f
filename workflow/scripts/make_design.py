"""Write the Sobol sets."""

from regional_lv.design import make_design
from regional_lv.progress import start_log

start_log(snakemake.log[0])
for name, table in make_design(snakemake.params.design, snakemake.params.seed).items():
    table.to_parquet(snakemake.output[name], index=False)
