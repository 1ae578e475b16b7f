"""The simulator against published and exact results; not part of `all`: `snakemake verify`."""

V = f"{R}/verification"
PUBLISHED_ROWS_COMPARED = {"train": 100, "test": 128}
SUBJECT_ROWS = sorted(s["row"] for s in config["subjects"].values() if s["row"] is not None)
# There are no other meshes of one that is kept as it was imported.
OF_MESHES = ["convergence", "mesh_study"] if meshes_anew(config) else []


rule verify:
    """Tables and figures of docs/verification.md."""
    input:
        expand(
            f"{V}/{{name}}.{{ext}}",
            name=["land", *OF_MESHES],
            ext=["png", "csv"],
        ),
        [f"{V}/orders.csv", f"{V}/mesh_study_summary.csv"] if OF_MESHES else [],


rule verify_land:
    output:
        results=f"{V}/land_results.csv",
    log:
        f"{LOGS}/verification/verify_land.log",
    benchmark:
        f"{R}/benchmarks/verify_land.tsv"
    params:
        call="verification.land:verify_land",
        solver=config["solver"],
    script:
        "../scripts/call.py"


rule verify_convergence:
    input:
        hearts=expand(LAYOUT.baseline("json", "{mesh}"), mesh=REFINEMENTS),
    output:
        errors=f"{V}/convergence_errors.csv",
        orders=f"{V}/orders.csv",
    log:
        f"{LOGS}/verification/verify_convergence.log",
    benchmark:
        f"{R}/benchmarks/verify_convergence.tsv"
    resources:
        **needs(mem_mb=4000, minutes=120),
    params:
        call="verification.convergence:verify_convergence",
    script:
        "../scripts/call.py"


rule plot_land:
    input:
        results=f"{V}/land_results.csv",
        published=given(os.path.relpath(packaged("land_2015.csv"))),
    output:
        png=f"{V}/land.png",
        csv=f"{V}/land.csv",
    log:
        f"{LOGS}/verification/plot_land.log",
    localrule: True
    params:
        call="plots.land:draw",
    script:
        "../scripts/call.py"


rule plot_convergence:
    input:
        errors=f"{V}/convergence_errors.csv",
        orders=f"{V}/orders.csv",
    output:
        png=f"{V}/convergence.png",
        csv=f"{V}/convergence.csv",
    log:
        f"{LOGS}/verification/plot_convergence.log",
    localrule: True
    params:
        call="plots.convergence:draw",
    script:
        "../scripts/call.py"


rule observe_mesh:
    """The reference mesh takes about half an hour, all others together a quarter."""
    input:
        mesh_file=LAYOUT.heart("mesh_study/{mesh}/").mesh,
    output:
        observables=f"{V}/meshes/{{mesh}}/observables.parquet",
    log:
        f"{LOGS}/verification/observe_mesh-{{mesh}}.log",
    benchmark:
        f"{R}/benchmarks/observe_mesh-{{mesh}}.tsv"
    resources:
        **needs(mem_mb=4000, minutes=120),
    params:
        call="verification.mesh_study:observe_mesh",
    script:
        "../scripts/call.py"


rule compare_meshes:
    input:
        tables=expand(f"{V}/meshes/{{mesh}}/observables.parquet", mesh=STUDY_MESHES),
    output:
        errors=f"{V}/mesh_errors.csv",
        summary=f"{V}/mesh_study_summary.csv",
    log:
        f"{LOGS}/verification/compare_meshes.log",
    localrule: True
    params:
        call="verification.mesh_study:compare_meshes",
        meshes=[name.replace("_", " ") for name in STUDY_MESHES],
    script:
        "../scripts/call.py"


rule plot_mesh_study:
    input:
        errors=f"{V}/mesh_errors.csv",
    output:
        png=f"{V}/mesh_study.png",
        csv=f"{V}/mesh_study.csv",
    log:
        f"{LOGS}/verification/plot_mesh_study.log",
    localrule: True
    params:
        call="plots.mesh_study:draw",
    script:
        "../scripts/call.py"


if config["geometry"]["source"] == "mesh" and IMPORTED["remesh"]:

    rule verify_imported_mesh:
        """Not part of `all`: the linear hexahedra of the published heart take half an hour."""
        input:
            imported=LAYOUT.heart().imported,
            remeshed=LAYOUT.heart().mesh,
            inputs=LAYOUT.published(TRAINING_INPUTS),
            outputs=LAYOUT.published(TRAINING_OUTPUTS),
        output:
            table=f"{R}/verification/imported_mesh.csv",
        log:
            f"{LOGS}/verification/verify_imported_mesh.log",
        benchmark:
            f"{R}/benchmarks/verify_imported_mesh.tsv"
        params:
            call="paper.imported_mesh:verify_imported_mesh",
        script:
            "../scripts/call.py"


if config["geometry"]["source"] == "mesh" and IMPORTED["file"] == PUBLISHED_HEART:

    rule simulate_published_rows:
        """Rows of a published table: of the training set, some that are no subject of this study."""
        input:
            mesh=LAYOUT.heart().mesh,
            predictor=LAYOUT.predictor(),
            inputs=lambda wildcards: published_table(wildcards.set, "inputs"),
            outputs=lambda wildcards: published_table(wildcards.set, "outputs"),
        output:
            rows=f"{V}/published_{{set}}.parquet",
        log:
            f"{LOGS}/verification/simulate_published_{{set}}.log",
        benchmark:
            f"{R}/benchmarks/simulate_published_{{set}}.tsv"
        wildcard_constraints:
            set=any_of(PUBLISHED_TABLES),
        params:
            call="paper.published_rows:simulate_published_rows",
            used=lambda wildcards: SUBJECT_ROWS if wildcards.set == "train" else [],
            most=lambda wildcards: PUBLISHED_ROWS_COMPARED[wildcards.set],
        script:
            "../scripts/call.py"

    rule summarise_published_rows:
        input:
            rows=f"{V}/published_{{set}}.parquet",
        output:
            summary=f"{V}/published_{{set}}.csv",
        log:
            f"{LOGS}/verification/summarise_published_{{set}}.log",
        wildcard_constraints:
            set=any_of(PUBLISHED_TABLES),
        localrule: True
        params:
            call="paper.published_rows:summarise_published_rows",
        script:
            "../scripts/call.py"
