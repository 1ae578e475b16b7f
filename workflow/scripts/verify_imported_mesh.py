"""Solve on the imported mesh and on the re-meshed one, and put the outputs side by side."""

from regional_lv.progress import start_log
from regional_lv.verification.imported_mesh import run

start_log(snakemake.log[0])
table = run(
    imported_vtu=snakemake.input.imported,
    remeshed_vtu=snakemake.input.remeshed,
    physics=snakemake.params.physics,
    inputs_csv=snakemake.input.inputs,
    outputs_csv=snakemake.input.outputs,
)
table.to_csv(snakemake.output[0], index=False)
