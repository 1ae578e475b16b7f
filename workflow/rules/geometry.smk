"""The mesh of the left ventricle with AHA segments, zones, surfaces and fibres.

Which rules there are depends on where the geometry comes from; one and only one makes mesh.vtu.
"""

if config["geometry"]["source"] == "segments":

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

else:

    rule import_mesh:
        input:
            **imported_files(),
            library=library("geometry.from_mesh"),
        output:
            f"{R}/geometry/imported.vtu",
        params:
            unit=IMPORTED["unit"],
            fibres=config["fibres"],
        log:
            f"{LOGS}/geometry/import_mesh.log",
        conda:
            "../../envs/geometry.yaml"
        script:
            "../scripts/import_mesh.py"

    if IMPORTED["remesh"]:

        rule remesh:
            input:
                imported=f"{R}/geometry/imported.vtu",
                library=library("geometry.from_mesh"),
            output:
                msh=f"{R}/geometry/mesh.msh",
                vtu=f"{R}/geometry/mesh.vtu",
                segments=f"{R}/geometry/segments.csv",
                summary=f"{R}/geometry/summary.json",
                fit=f"{R}/geometry/fit.csv",
            params:
                mesh=config["mesh"],
                fibres=config["fibres"],
            log:
                f"{LOGS}/geometry/remesh.log",
            conda:
                "../../envs/geometry.yaml"
            script:
                "../scripts/remesh.py"

    else:

        rule keep_mesh:
            """The imported mesh as it is."""
            input:
                imported=f"{R}/geometry/imported.vtu",
                library=library("geometry.from_mesh"),
            output:
                vtu=f"{R}/geometry/mesh.vtu",
                segments=f"{R}/geometry/segments.csv",
                summary=f"{R}/geometry/summary.json",
            params:
                fibres=config["fibres"],
            log:
                f"{LOGS}/geometry/keep_mesh.log",
            conda:
                "../../envs/geometry.yaml"
            script:
                "../scripts/keep_mesh.py"
