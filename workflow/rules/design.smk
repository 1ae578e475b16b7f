"""Where to simulate: the Sobol sets."""


rule make_design:
    input:
        library=library("design"),
    output:
        train=f"{R}/design/train.parquet",
        test=f"{R}/design/test.parquet",
    params:
        design=config["design"],
        seed=config["seed"],
    log:
        f"{LOGS}/design/make_design.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/make_design.py"


rule draw_scenario:
    """Ventricles with simulated disease."""
    input:
        library=library("design"),
    output:
        f"{R}/design/{{scenario}}.parquet",
    params:
        scenario=lambda wildcards: SCENARIOS[wildcards.scenario],
        healthy=HEALTHY,
        bounds=BOUNDS,
        seed=config["seed"],
    wildcard_constraints:
        scenario=any_of(SCENARIOS),
    log:
        f"{LOGS}/design/draw_scenario-{{scenario}}.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/draw_scenario.py"
