"""Draw the strain field and its spread within the zones."""

from regional_lv.figures import strain_field
from regional_lv.progress import start_log

start_log(snakemake.log[0])
strain_field.draw(
    snakemake.input.mesh, snakemake.input.strains, snakemake.output.png, snakemake.output.csv
)
