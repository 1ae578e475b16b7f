"""Batches of simulations, each started from the predicted field alone."""

# The first rows of the training design are solved already.
ANCHOR_TABLES = expand(LAYOUT.anchors("{batch}", "parquet"), batch=ANCHOR_BATCHES)

SIMULATION_BATCHES = {
    name: batches(size, config["simulations"]["batch_size"])
    for name, size in {
        "train": config["design"]["natural"] + config["design"]["log"],
        "test": config["design"]["test"],
        **{name: SETS[name] for name in SCENARIOS},
        "resimulated": config["trust"]["resimulated_cases"] * config["trust"]["resimulated_draws"],
    }.items()
}


rule simulate_batch:
    input:
        mesh=LAYOUT.heart().mesh,
        predictor=LAYOUT.predictor(),
        design=LAYOUT.design("{set}"),
        anchors=lambda wildcards: ANCHOR_TABLES if wildcards.set == "train" else [],
    output:
        simulations=LAYOUT.simulations("{set}", "{batch}"),
    log:
        f"{LOGS}/simulations/{{set}}/batch-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/simulations/{{set}}/batch-{{batch}}.tsv"
    wildcard_constraints:
        set=any_of(SIMULATION_BATCHES),
    priority: FIRST
    threads: 1
    resources:
        **needs(minutes=60),
    params:
        call="simulation.batches:simulate_batch",
        batch_size=config["simulations"]["batch_size"],
    script:
        "../scripts/call.py"
