"""The mesh of the left ventricle with AHA segments, zones, surfaces and fibres."""


rule make_mesh:
    input:
        segments=config["geometry"]["segments"],
        library=library("geometry.make"),
    output:
        msh=f"{R}/geometry/mesh.msh",
        vtu=f"{R}/geometry/mesh.vtu",
        segments=f"{R}/geometry/segments.csv",
        summary=f"{R}/geometry/summary.json",
    params:
        endo_apex_z_mm=config["geometry"]["endo_apex_z_mm"],
        epi_apex_z_mm=config["geometry"]["epi_apex_z_mm"],
        mesh=config["mesh"],
        fibres=config["fibres"],
    log:
        f"{LOGS}/geometry/make_mesh.log",
    conda:
        "../../envs/geometry.yaml"
    script:
        "../scripts/make_mesh.py"
