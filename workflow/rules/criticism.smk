"""What the simulation gets wrong, why, and what mending it gains."""

C = f"{R}/criticism"
HYPOTHESES = asked(config["criticism"]["hypotheses"], PHYSICS)
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
