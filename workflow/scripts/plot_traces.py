"""Draw one subject's chains."""

from regional_lv.figures import traces
from regional_lv.progress import start_log

start_log(snakemake.log[0])
traces.draw(
    snakemake.input.posterior,
    snakemake.input.diagnostics,
    snakemake.params.source,
    snakemake.output.png,
    snakemake.output.csv,
    truth=snakemake.input.truth or None,
)
