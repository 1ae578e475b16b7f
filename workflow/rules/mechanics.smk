"""The start of every simulation: one cold inflation, which also compiles the forms once."""


rule solve_baseline:
    input:
        mesh=f"{R}/geometry/mesh.vtu",
        library=library("simulations"),
    output:
        start=f"{R}/mechanics/baseline.npz",
        summary=f"{R}/mechanics/baseline.json",
    params:
        physics=PHYSICS,
        bounds=BOUNDS,
    log:
        f"{LOGS}/mechanics/solve_baseline.log",
    benchmark:
        f"{R}/benchmarks/solve_baseline.tsv"
    conda:
        "../../envs/mechanics.yaml"
    script:
        "../scripts/solve_baseline.py"


rule calibrate_reference:
    """Not part of `all`: its result is written by hand into the config's `material` section."""
    input:
        mesh=f"{R}/geometry/mesh.vtu",
        start=f"{R}/mechanics/baseline.npz",
        library=library("calibration"),
    output:
        f"{R}/mechanics/calibration.json",
    params:
        physics=PHYSICS,
    log:
        f"{LOGS}/mechanics/calibrate_reference.log",
    conda:
        "../../envs/mechanics.yaml"
    script:
        "../scripts/calibrate_reference.py"
