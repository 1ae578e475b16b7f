"""Where the time went. Not among the tables: it differs from run to run, and they do not."""


rule tabulate_costs:
    input:
        FIGURES,
        TABLES,
        SUMMARIES,
        library=library("tables.costs"),
    output:
        f"{R}/benchmarks/costs.csv",
    log:
        f"{LOGS}/costs.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/tabulate_costs.py"
