"""Standardised strains and their principal components."""


rule fit_reduction:
    input:
        train=LAYOUT.screened("train"),
    output:
        reduction=f"{R}/reduction/reduction.npz",
        explained=LAYOUT.explained_variance,
    log:
        f"{LOGS}/reduction/fit_reduction.log",
    localrule: True
    params:
        call="emulators.reduction:fit_reduction",
        channels=OUTPUTS,
        explained_variance=config["reduction"]["explained_variance"],
    script:
        "../scripts/call.py"
