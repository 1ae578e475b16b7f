"""Import a hexahedral mesh from elsewhere."""

from regional_lv.geometry.from_mesh import write_imported
from regional_lv.progress import start_log

start_log(snakemake.log[0])
write_imported(
    mesh_path=snakemake.input.mesh,
    segments_path=snakemake.input.get("segments"),
    unit=snakemake.params.unit,
    fibres_cfg=snakemake.params.fibres,
    vtu_path=snakemake.output[0],
)
