"""The simulator against published and exact results; not part of `all`: `snakemake verify`."""

V = f"{R}/verification"
# Uniform refinement of the heart: elements around, rows of each level and layers grow alike.
REFINEMENTS = {"1": 16, "2": 32, "3": 48}
REFINED_ROWS = ["basal", "mid", "apical", "apex", "transmural"]
# Meshes that are compared with one at least twice as fine as the study's in every direction.
STUDY_MESHES = {
    "quick": {"circumferential": 16, "basal": 2, "apical": 1, "apex": 1, "transmural": 1},
    "one row": {"apical": 1, "apex": 1},
    "one row, one layer": {"apical": 1, "apex": 1, "transmural": 1},
    "one row, three layers": {"apical": 1, "apex": 1, "transmural": 3},
    "study": {},
    "fine": {"circumferential": 32, "basal": 4, "mid": 3, "apex": 1},
    "reference": {
        "circumferential": 48,
        "basal": 6,
        "basal_grading": 0.707,
        "mid": 4,
        "apical": 4,
        "apex": 4,
        "transmural": 4,
    },
}


rule verify:
    """Tables and figures of docs/verification.md."""
    input:
        expand(
            f"{V}/{{name}}.{{ext}}",
            name=["land", "convergence", "mesh_study"],
            ext=["png", "csv"],
        ),
        f"{V}/orders.csv",
        f"{V}/mesh_study_summary.csv",


rule verify_land:
    input:
        library=library("verification.land"),
    output:
        f"{V}/land_results.csv",
    params:
        solver=config["solver"],
    log:
        f"{LOGS}/verification/verify_land.log",
    benchmark:
        f"{R}/benchmarks/verify_land.tsv"
    conda:
        "../../envs/mechanics.yaml"
    script:
        "../scripts/verify_land.py"


rule make_refined_mesh:
    input:
        segments=config["geometry"]["segments"],
        library=library("geometry.make"),
    output:
        msh=f"{V}/heart/{{refinement}}/mesh.msh",
        vtu=f"{V}/heart/{{refinement}}/mesh.vtu",
        segments=f"{V}/heart/{{refinement}}/segments.csv",
        summary=f"{V}/heart/{{refinement}}/summary.json",
    params:
        endo_apex_z_mm=config["geometry"]["endo_apex_z_mm"],
        epi_apex_z_mm=config["geometry"]["epi_apex_z_mm"],
        mesh=lambda wildcards: config["mesh"]
        | {"circumferential": REFINEMENTS[wildcards.refinement]}
        | dict.fromkeys(REFINED_ROWS, int(wildcards.refinement)),
        fibres=config["fibres"],
    log:
        f"{LOGS}/verification/make_refined_mesh-{{refinement}}.log",
    conda:
        "../../envs/geometry.yaml"
    script:
        "../scripts/make_mesh.py"


rule solve_refined_heart:
    input:
        mesh=f"{V}/heart/{{refinement}}/mesh.vtu",
        library=library("simulations"),
    output:
        start=temp(f"{V}/heart/{{refinement}}/baseline.npz"),
        summary=f"{V}/heart/{{refinement}}/baseline.json",
    params:
        physics=PHYSICS,
        bounds=BOUNDS,
    log:
        f"{LOGS}/verification/solve_refined_heart-{{refinement}}.log",
    benchmark:
        f"{R}/benchmarks/solve_refined_heart-{{refinement}}.tsv"
    conda:
        "../../envs/mechanics.yaml"
    script:
        "../scripts/solve_baseline.py"


rule verify_convergence:
    input:
        hearts=expand(f"{V}/heart/{{refinement}}/baseline.json", refinement=REFINEMENTS),
        library=library("verification.convergence"),
    output:
        errors=f"{V}/convergence_errors.csv",
        orders=f"{V}/orders.csv",
    params:
        physics=PHYSICS,
    log:
        f"{LOGS}/verification/verify_convergence.log",
    benchmark:
        f"{R}/benchmarks/verify_convergence.tsv"
    conda:
        "../../envs/mechanics.yaml"
    script:
        "../scripts/verify_convergence.py"


rule plot_land:
    input:
        results=f"{V}/land_results.csv",
        published="resources/land_2015.csv",
        library=library("figures.land"),
    output:
        png=f"{V}/land.png",
        csv=f"{V}/land.csv",
    log:
        f"{LOGS}/verification/plot_land.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_land.py"


rule plot_convergence:
    input:
        errors=f"{V}/convergence_errors.csv",
        orders=f"{V}/orders.csv",
        library=library("figures.convergence"),
    output:
        png=f"{V}/convergence.png",
        csv=f"{V}/convergence.csv",
    log:
        f"{LOGS}/verification/plot_convergence.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_convergence.py"


rule make_study_mesh:
    input:
        segments=config["geometry"]["segments"],
        library=library("geometry.make"),
    output:
        msh=temp(f"{V}/meshes/{{mesh}}/mesh.msh"),
        vtu=f"{V}/meshes/{{mesh}}/mesh.vtu",
        segments=f"{V}/meshes/{{mesh}}/segments.csv",
        summary=f"{V}/meshes/{{mesh}}/summary.json",
    params:
        endo_apex_z_mm=config["geometry"]["endo_apex_z_mm"],
        epi_apex_z_mm=config["geometry"]["epi_apex_z_mm"],
        mesh=lambda wildcards: config["mesh"] | STUDY_MESHES[wildcards.mesh],
        fibres=config["fibres"],
    log:
        f"{LOGS}/verification/make_study_mesh-{{mesh}}.log",
    conda:
        "../../envs/geometry.yaml"
    script:
        "../scripts/make_mesh.py"


rule observe_mesh:
    """The reference mesh takes about half an hour, all others together a quarter."""
    input:
        mesh=f"{V}/meshes/{{mesh}}/mesh.vtu",
        library=library("verification.mesh_study"),
    output:
        f"{V}/meshes/{{mesh}}/observables.parquet",
    params:
        physics=PHYSICS,
        design=config["design"],
        seed=config["seed"],
    log:
        f"{LOGS}/verification/observe_mesh-{{mesh}}.log",
    benchmark:
        f"{R}/benchmarks/observe_mesh-{{mesh}}.tsv"
    conda:
        "../../envs/mechanics.yaml"
    script:
        "../scripts/observe_mesh.py"


rule compare_meshes:
    input:
        tables=expand(f"{V}/meshes/{{mesh}}/observables.parquet", mesh=STUDY_MESHES),
        library=library("verification.mesh_study"),
    output:
        errors=f"{V}/mesh_errors.csv",
        summary=f"{V}/mesh_study_summary.csv",
    params:
        meshes=list(STUDY_MESHES),
    log:
        f"{LOGS}/verification/compare_meshes.log",
    conda:
        "../../envs/mechanics.yaml"
    script:
        "../scripts/compare_meshes.py"


rule plot_mesh_study:
    input:
        errors=f"{V}/mesh_errors.csv",
        library=library("figures.mesh_study"),
    output:
        png=f"{V}/mesh_study.png",
        csv=f"{V}/mesh_study.csv",
    log:
        f"{LOGS}/verification/plot_mesh_study.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_mesh_study.py"
