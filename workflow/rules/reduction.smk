"""Standardised strains and their principal components."""


rule fit_reduction:
    input:
        train=f"{R}/screening/train.parquet",
    output:
        reduction=f"{R}/reduction/reduction.npz",
        explained=f"{R}/reduction/explained_variance.csv",
    log:
        f"{LOGS}/reduction/fit_reduction.log",
    localrule: True
    params:
        call="emulators.reduction:fit_reduction",
        channels=OUTPUTS,
        explained_variance=config["reduction"]["explained_variance"],
    script:
        "../scripts/call.py"
