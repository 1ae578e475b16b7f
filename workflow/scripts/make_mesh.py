"""Make the mesh of the left ventricle from its segment table."""

from regional_lv.geometry.make import make_mesh
from regional_lv.progress import start_log

start_log(snakemake.log[0])
make_mesh(
    segments_csv=snakemake.input.segments,
    endo_apex_z_mm=snakemake.params.endo_apex_z_mm,
    epi_apex_z_mm=snakemake.params.epi_apex_z_mm,
    mesh_cfg=snakemake.params.mesh,
    fibres_cfg=snakemake.params.fibres,
    msh_path=snakemake.output.msh,
    vtu_path=snakemake.output.vtu,
    segments_out_csv=snakemake.output.segments,
    summary_json=snakemake.output.summary,
)
