"""Fit the principal components of the strains."""

from regional_lv.progress import start_log
from regional_lv.reduction import fit_reduction

start_log(snakemake.log[0])
fit_reduction(
    snakemake.input.train,
    snakemake.params.explained_variance,
    snakemake.output.reduction,
    snakemake.output.explained,
)
