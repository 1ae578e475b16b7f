"""Posteriors by NUTS: of the test set in batches, of every subject, and what they are worth."""

TEST_CASES = (
    config["design"]["test"]
    if config["test_posteriors"]["cases"] == "all"
    else min(config["test_posteriors"]["cases"], config["design"]["test"])
)


rule sample_posteriors:
    input:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        test=f"{R}/screening/test.parquet",
        library=library("inference"),
    output:
        f"{R}/posteriors/{{emulator}}/test/batch-{{batch}}.nc",
    params:
        first=lambda wildcards: int(wildcards.batch) * config["nuts"]["cases_per_batch"],
        last=lambda wildcards: min(
            (int(wildcards.batch) + 1) * config["nuts"]["cases_per_batch"], TEST_CASES
        ),
        sampler=config["test_posteriors"]["sampler"],
        nuts=config["nuts"],
        map=config["map"],
        seed=config["seed"],
    log:
        f"{LOGS}/posteriors/{{emulator}}/test/batch-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/test/batch-{{batch}}.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/sample_posteriors.py"


rule summarise_posteriors:
    input:
        posteriors=lambda wildcards: expand(
            f"{R}/posteriors/{wildcards.emulator}/test/{{batch}}.nc",
            batch=batches(TEST_CASES, config["nuts"]["cases_per_batch"]),
        ),
        library=library("inference.diagnostics"),
    output:
        diagnostics=f"{R}/posteriors/{{emulator}}/test/diagnostics.csv",
        recovery=f"{R}/posteriors/{{emulator}}/test/recovery.csv",
        coverage=f"{R}/posteriors/{{emulator}}/test/coverage.csv",
        map_mse=f"{R}/posteriors/{{emulator}}/test/map_mse.csv",
    log:
        f"{LOGS}/posteriors/{{emulator}}/summarise.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/summarise_posteriors.py"


rule sample_subject:
    input:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        measured=f"{R}/measured/{{subject}}.csv",
        library=library("inference"),
    output:
        posterior=f"{R}/posteriors/{{emulator}}/subjects/{{subject}}.nc",
        diagnostics=f"{R}/posteriors/{{emulator}}/subjects/{{subject}}.csv",
    params:
        nuts=config["nuts"],
        map=config["map"],
        noise_prior_scale=config["clinical"]["noise_prior_scale"],
        seed=config["seed"],
    log:
        f"{LOGS}/posteriors/{{emulator}}/subjects/{{subject}}.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/subjects/{{subject}}.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/sample_subject.py"
