"""Mesh the imported ventricle anew and compare the two."""

from regional_lv.geometry.from_mesh import remesh
from regional_lv.progress import start_log

start_log(snakemake.log[0])
remesh(
    imported_vtu=snakemake.input.imported,
    mesh_cfg=snakemake.params.mesh,
    fibres_cfg=snakemake.params.fibres,
    msh_path=snakemake.output.msh,
    vtu_path=snakemake.output.vtu,
    segments_csv=snakemake.output.segments,
    summary_json=snakemake.output.summary,
    fit_csv=snakemake.output.fit,
)
