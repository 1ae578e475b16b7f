"""Write the strain field at theta = 1."""

from regional_lv.progress import start_log
from regional_lv.strains import map_strains

start_log(snakemake.log[0])
map_strains(
    snakemake.input.mesh,
    snakemake.params.physics,
    snakemake.input.predictor,
    snakemake.output.table,
    snakemake.output.mesh,
)
