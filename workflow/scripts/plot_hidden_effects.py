"""Draw confusions and power of the benchmark of hidden effects."""

from regional_lv.figures import hidden_effects
from regional_lv.progress import start_log

start_log(snakemake.log[0])
hidden_effects.draw(snakemake.input.cases, snakemake.output.png, snakemake.output.csv)
