"""Draw truth against MAP on the bullseye."""

from regional_lv.figures import bullseye_map
from regional_lv.progress import start_log

start_log(snakemake.log[0])
bullseye_map.draw(
    snakemake.input.recovery,
    snakemake.params.labels,
    snakemake.params.zones,
    snakemake.params.title,
    snakemake.output.png,
    snakemake.output.csv,
)
