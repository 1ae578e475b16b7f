"""Computing time by step. Not among the tables: it differs from run to run, and they do not."""


rule tabulate_costs:
    input:
        FIGURES,
        TABLES,
        SUMMARIES,
    output:
        table=f"{R}/benchmarks/costs.csv",
    log:
        f"{LOGS}/costs.log",
    localrule: True
    params:
        call="tables.costs:tabulate_costs",
    script:
        "../scripts/call.py"
