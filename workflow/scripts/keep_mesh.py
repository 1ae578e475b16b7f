"""Take the imported mesh as it is."""

from regional_lv.geometry.from_mesh import keep_mesh
from regional_lv.progress import start_log

start_log(snakemake.log[0])
keep_mesh(
    imported_vtu=snakemake.input.imported,
    fibres_cfg=snakemake.params.fibres,
    vtu_path=snakemake.output.vtu,
    segments_csv=snakemake.output.segments,
    summary_json=snakemake.output.summary,
)
