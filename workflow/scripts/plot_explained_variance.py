"""Draw the variance that the principal components explain."""

from regional_lv.figures import explained_variance
from regional_lv.progress import start_log

start_log(snakemake.log[0])
explained_variance.draw(
    snakemake.input.explained,
    snakemake.output.png,
    snakemake.output.csv,
    snakemake.params.threshold,
)
