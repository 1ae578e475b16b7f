"""The mesh of the left ventricle with AHA segments, zones, surfaces and fibres.

Which rules there are depends on where the geometry comes from; one and only one makes the meshes.
"""

HEART = LAYOUT.heart("{mesh_folder}")
MADE = {
    "msh": HEART.gmsh,
    "vtu": HEART.mesh,
    "segments": HEART.segments,
    "summary": HEART.summary,
}


wildcard_constraints:
    mesh_folder=any_of(MESHES),


if config["geometry"]["source"] == "segments":

    rule make_mesh:
        input:
            table=SEGMENT_TABLE,
        output:
            **MADE,
        log:
            f"{LOGS}/geometry/{{mesh_folder}}make_mesh.log",
        params:
            call="geometry.make:make_mesh",
            endo_apex_z_mm=config["geometry"]["endo_apex_z_mm"],
            epi_apex_z_mm=config["geometry"]["epi_apex_z_mm"],
            mesh=mesh_of,
            zones=PARAMETER_SPEC["zones"],
        script:
            "../scripts/call.py"

elif config["geometry"]["source"] == "surfaces":

    rule mesh_surfaces:
        input:
            endocardium=given(GIVEN_SURFACES["endocardium"]),
            epicardium=given(GIVEN_SURFACES["epicardium"]),
        output:
            **MADE,
        log:
            f"{LOGS}/geometry/{{mesh_folder}}mesh_surfaces.log",
        params:
            call="geometry.from_surfaces:mesh_surfaces",
            surfaces=GIVEN_SURFACES,
            mesh=mesh_of,
            zones=PARAMETER_SPEC["zones"],
        script:
            "../scripts/call.py"

else:

    rule import_mesh:
        input:
            **imported_files(),
        output:
            vtu=LAYOUT.heart().imported,
        log:
            f"{LOGS}/geometry/import_mesh.log",
        params:
            call="geometry.from_mesh:write_imported",
            unit=IMPORTED["unit"],
            zones=PARAMETER_SPEC["zones"],
        script:
            "../scripts/call.py"

    if IMPORTED["remesh"]:

        rule remesh:
            input:
                imported=LAYOUT.heart().imported,
            output:
                **MADE,
                fit=HEART.fit,
            log:
                f"{LOGS}/geometry/{{mesh_folder}}remesh.log",
            params:
                call="geometry.from_mesh:remesh",
                mesh=mesh_of,
                zones=PARAMETER_SPEC["zones"],
            script:
                "../scripts/call.py"

    else:

        rule keep_mesh:
            """The imported mesh as it is."""
            input:
                imported=LAYOUT.heart().imported,
            output:
                vtu=LAYOUT.heart().mesh,
                segments=LAYOUT.heart().segments,
                summary=LAYOUT.heart().summary,
            log:
                f"{LOGS}/geometry/keep_mesh.log",
            params:
                call="geometry.from_mesh:keep_mesh",
                zones=PARAMETER_SPEC["zones"],
            script:
                "../scripts/call.py"
