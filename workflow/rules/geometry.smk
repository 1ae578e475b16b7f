"""The mesh of the left ventricle with AHA segments, zones, surfaces and fibres.

Which rules there are depends on where the geometry comes from; one and only one makes mesh.vtu.
"""

if config["geometry"]["source"] == "segments":

    rule make_mesh:
        input:
            table=SEGMENT_TABLE,
        output:
            msh=f"{R}/geometry/mesh.msh",
            vtu=f"{R}/geometry/mesh.vtu",
            segments=f"{R}/geometry/segments.csv",
            summary=f"{R}/geometry/summary.json",
        params:
            call="geometry.make:make_mesh",
            endo_apex_z_mm=config["geometry"]["endo_apex_z_mm"],
            epi_apex_z_mm=config["geometry"]["epi_apex_z_mm"],
            mesh=config["mesh"],
            fibres=config["fibres"],
            zones=PARAMETER_SPEC["zones"],
        log:
            f"{LOGS}/geometry/make_mesh.log",
        script:
            "../scripts/call.py"

    rule make_finer_mesh:
        """What synthetic hearts are simulated on, apart from the study's own errors."""
        input:
            table=SEGMENT_TABLE,
        output:
            msh=f"{R}/geometry/finer/mesh.msh",
            vtu=f"{R}/geometry/finer/mesh.vtu",
            segments=f"{R}/geometry/finer/segments.csv",
            summary=f"{R}/geometry/finer/summary.json",
        params:
            call="geometry.make:make_mesh",
            endo_apex_z_mm=config["geometry"]["endo_apex_z_mm"],
            epi_apex_z_mm=config["geometry"]["epi_apex_z_mm"],
            mesh=config["mesh"],
            refined=True,
            fibres=config["fibres"],
            zones=PARAMETER_SPEC["zones"],
        log:
            f"{LOGS}/geometry/make_finer_mesh.log",
        script:
            "../scripts/call.py"

elif config["geometry"]["source"] == "surfaces":

    rule mesh_surfaces:
        input:
            endocardium=GIVEN_SURFACES["endocardium"],
            epicardium=GIVEN_SURFACES["epicardium"],
        output:
            msh=f"{R}/geometry/mesh.msh",
            vtu=f"{R}/geometry/mesh.vtu",
            segments=f"{R}/geometry/segments.csv",
            summary=f"{R}/geometry/summary.json",
        params:
            call="geometry.from_surfaces:mesh_surfaces",
            surfaces=GIVEN_SURFACES,
            mesh=config["mesh"],
            fibres=config["fibres"],
            zones=PARAMETER_SPEC["zones"],
        log:
            f"{LOGS}/geometry/mesh_surfaces.log",
        script:
            "../scripts/call.py"

    rule mesh_surfaces_finer:
        """What synthetic hearts are simulated on, apart from the study's own errors."""
        input:
            endocardium=GIVEN_SURFACES["endocardium"],
            epicardium=GIVEN_SURFACES["epicardium"],
        output:
            msh=f"{R}/geometry/finer/mesh.msh",
            vtu=f"{R}/geometry/finer/mesh.vtu",
            segments=f"{R}/geometry/finer/segments.csv",
            summary=f"{R}/geometry/finer/summary.json",
        params:
            call="geometry.from_surfaces:mesh_surfaces",
            surfaces=GIVEN_SURFACES,
            mesh=config["mesh"],
            refined=True,
            fibres=config["fibres"],
            zones=PARAMETER_SPEC["zones"],
        log:
            f"{LOGS}/geometry/mesh_surfaces_finer.log",
        script:
            "../scripts/call.py"

else:

    rule import_mesh:
        input:
            **imported_files(),
        output:
            vtu=f"{R}/geometry/imported.vtu",
        params:
            call="geometry.from_mesh:write_imported",
            unit=IMPORTED["unit"],
            fibres=config["fibres"],
            zones=PARAMETER_SPEC["zones"],
        log:
            f"{LOGS}/geometry/import_mesh.log",
        script:
            "../scripts/call.py"

    if IMPORTED["remesh"]:

        rule remesh:
            input:
                imported=f"{R}/geometry/imported.vtu",
            output:
                msh=f"{R}/geometry/mesh.msh",
                vtu=f"{R}/geometry/mesh.vtu",
                segments=f"{R}/geometry/segments.csv",
                summary=f"{R}/geometry/summary.json",
                fit=f"{R}/geometry/fit.csv",
            params:
                call="geometry.from_mesh:remesh",
                mesh=config["mesh"],
                fibres=config["fibres"],
                zones=PARAMETER_SPEC["zones"],
            log:
                f"{LOGS}/geometry/remesh.log",
            script:
                "../scripts/call.py"

    else:

        rule keep_mesh:
            """The imported mesh as it is."""
            input:
                imported=f"{R}/geometry/imported.vtu",
            output:
                vtu=f"{R}/geometry/mesh.vtu",
                segments=f"{R}/geometry/segments.csv",
                summary=f"{R}/geometry/summary.json",
            params:
                call="geometry.from_mesh:keep_mesh",
                fibres=config["fibres"],
                zones=PARAMETER_SPEC["zones"],
            log:
                f"{LOGS}/geometry/keep_mesh.log",
            script:
                "../scripts/call.py"
