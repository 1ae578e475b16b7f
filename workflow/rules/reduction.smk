"""Standardised strains and their principal components."""


rule fit_reduction:
    input:
        train=f"{R}/screening/train.parquet",
        library=library("reduction"),
    output:
        reduction=f"{R}/reduction/reduction.npz",
        explained=f"{R}/reduction/explained_variance.csv",
    params:
        explained_variance=config["reduction"]["explained_variance"],
    log:
        f"{LOGS}/reduction/fit_reduction.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/fit_reduction.py"
