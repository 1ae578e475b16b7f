"""Draw the mesh and its five zones."""

from regional_lv.figures import zones
from regional_lv.progress import start_log

start_log(snakemake.log[0])
zones.draw(snakemake.input.mesh, snakemake.output.png, snakemake.output.csv)
