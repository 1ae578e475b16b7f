"""Draw the errors of the mesh study's meshes."""

from regional_lv.figures import mesh_study
from regional_lv.progress import start_log

start_log(snakemake.log[0])
mesh_study.draw(snakemake.input.errors, snakemake.output.png, snakemake.output.csv)
