"""What the simulation gets wrong, why, and what mending it gains."""

C = f"{R}/criticism"
HYPOTHESES = asked(config["criticism"]["hypotheses"], PHYSICS)
PLANTED_BATCHES = batches(
    config["criticism"]["benchmark"]["planted"] + config["criticism"]["benchmark"]["null"],
    config["simulations"]["batch_size"],
)
EXTENSIONS = expand(f"{C}/extensions/{{hypothesis}}.pt", hypothesis=HYPOTHESES)


rule extensions:
    """What every hypothesis changes, for all subjects of the study."""
    input:
        EXTENSIONS,


rule simulate_extension:
    """From the anchors' fields; the anchors of one batch at all values of one effect."""
    input:
        mesh=f"{R}/geometry/mesh.vtu",
        anchors=f"{R}/mechanics/anchors/batch-{{batch}}.npz",
        # Not the whole catalogue: another hypothesis does not change this one's simulations.
        library=lambda wildcards: library(
            "criticism.simulation", f"criticism.hypotheses.{wildcards.hypothesis}"
        ),
    output:
        f"{C}/simulations/{{hypothesis}}/batch-{{batch}}.parquet",
    params:
        physics=PHYSICS,
        most=lambda wildcards: anchors_per_batch(HYPOTHESES[wildcards.hypothesis]),
    wildcard_constraints:
        hypothesis="|".join(HYPOTHESES),
    log:
        f"{LOGS}/criticism/simulations/{{hypothesis}}-batch-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/simulations/{{hypothesis}}-batch-{{batch}}.tsv"
    threads: 1
    conda:
        "../../envs/mechanics.yaml"
    script:
        "../scripts/simulate_extension.py"


rule train_extension:
    """Closed forms need no simulations; their file says what they are."""
    input:
        batches=lambda wildcards: extension_batches(HYPOTHESES[wildcards.hypothesis]),
        library=library("criticism.extension"),
    output:
        extension=f"{C}/extensions/{{hypothesis}}.pt",
        report=f"{C}/extensions/{{hypothesis}}.json",
    params:
        physics=PHYSICS,
        bounds=BOUNDS,
        seed=config["seed"],
    wildcard_constraints:
        hypothesis="|".join(HYPOTHESES),
    log:
        f"{LOGS}/criticism/extensions/{{hypothesis}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/extensions/{{hypothesis}}.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/train_extension.py"


rule plant_batch:
    """Ventricles with hidden effects; writes their truth and reads none."""
    input:
        mesh=f"{R}/geometry/mesh.vtu",
        predictor=f"{R}/mechanics/predictor.npz",
        library=library("criticism.planted"),
    output:
        subjects=temp(f"{C}/benchmark/subjects/batch-{{batch}}.parquet"),
        truth=temp(f"{R}/truth/benchmark/batch-{{batch}}.parquet"),
    params:
        physics=PHYSICS,
        hypotheses=config["criticism"]["hypotheses"],
        benchmark=config["criticism"]["benchmark"],
        bounds=BOUNDS,
        seed=config["seed"],
        batch_size=config["simulations"]["batch_size"],
    log:
        f"{LOGS}/criticism/benchmark/plant-batch-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/benchmark/plant-batch-{{batch}}.tsv"
    threads: 1
    conda:
        "../../envs/mechanics.yaml"
    script:
        "../scripts/plant_batch.py"


rule plant_subjects:
    input:
        expand(f"{C}/benchmark/subjects/{{batch}}.parquet", batch=PLANTED_BATCHES),
    output:
        f"{C}/benchmark/subjects.parquet",
    log:
        f"{LOGS}/criticism/benchmark/plant_subjects.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/gather.py"


rule gather_truth:
    """For the score of the benchmark alone."""
    input:
        expand(f"{R}/truth/benchmark/{{batch}}.parquet", batch=PLANTED_BATCHES),
    output:
        f"{R}/truth/benchmark.parquet",
    log:
        f"{LOGS}/criticism/benchmark/gather_truth.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/gather.py"
