"""Convergence screening: what is learnt from, what is left out and where that lies."""


rule screen_simulations:
    input:
        batches=lambda wildcards: expand(
            f"{R}/simulations/{wildcards.set}/{{batch}}.parquet",
            batch=SIMULATION_BATCHES[wildcards.set],
        ),
        library=library("screening"),
    output:
        kept=f"{R}/screening/{{set}}.parquet",
        excluded=f"{R}/screening/{{set}}_excluded.csv",
        summary=f"{R}/screening/{{set}}_summary.csv",
    params:
        bounds=BOUNDS,
    wildcard_constraints:
        set=any_of(SIMULATION_BATCHES),
    log:
        f"{LOGS}/screening/{{set}}.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/screen_simulations.py"
