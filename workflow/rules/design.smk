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
