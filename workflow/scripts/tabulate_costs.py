"""Sum the benchmarks of the study by step."""

from pathlib import Path

from regional_lv.progress import start_log
from regional_lv.tables.costs import costs

start_log(snakemake.log[0])
output = Path(snakemake.output[0])
costs(output.parent).to_csv(output, index=False, float_format="%.1f")
