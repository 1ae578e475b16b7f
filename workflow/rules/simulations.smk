"""Batches of simulations, each started from the predicted field alone."""

# The first rows of the training design are solved already.
ANCHOR_TABLES = expand(f"{R}/mechanics/anchors/{{batch}}.parquet", batch=ANCHOR_BATCHES)

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
        mesh=f"{R}/geometry/mesh.vtu",
        predictor=f"{R}/mechanics/predictor.npz",
        design=f"{R}/design/{{set}}.parquet",
        anchors=lambda wildcards: ANCHOR_TABLES if wildcards.set == "train" else [],
    output:
        simulations=f"{R}/simulations/{{set}}/batch-{{batch}}.parquet",
    log:
        f"{LOGS}/simulations/{{set}}/batch-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/simulations/{{set}}/batch-{{batch}}.tsv"
    wildcard_constraints:
        set=any_of(SIMULATION_BATCHES),
    priority: FIRST
    threads: 1
    params:
        call="simulation.batches:simulate_batch",
        batch_size=config["simulations"]["batch_size"],
    script:
        "../scripts/call.py"
