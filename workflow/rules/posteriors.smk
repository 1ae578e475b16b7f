"""Posteriors: of the test set and the scenarios in batches, of every subject, what they are worth."""

SET_TABLES = [
    f"{name}.csv"
    for name in (
        *("diagnostics", "recovery", "coverage", "map_mse", "hpd"),
        *("correlations", "zone_correlations"),
    )
]
SCENARIO_TABLES = ["told_apart.csv", "map_errors_by_zone.csv", "roc.csv", "auc.csv"]
SUMMARIES = (
    expand(f"{R}/posteriors/{EMULATOR}/test/{{table}}", table=SET_TABLES)
    + expand(
        f"{R}/posteriors/{EMULATOR}/{{set}}/{{table}}",
        set=[*SCENARIOS, *NOISY],
        table=["coverage.csv", *SCENARIO_TABLES],
    )
    + expand(
        f"{R}/posteriors/{EMULATOR}/{{table}}.csv",
        table=["sampler_agreement", "sbc", *([] if FROM_TABLES else ["resimulated"])],
    )
    + expand(
        f"{R}/posteriors/{EMULATOR}/subjects/{{subject}}_noise_prior.csv", subject=NOISE_INFERRED
    )
)


rule sample_posteriors:
    input:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        simulations=lambda wildcards: (
            f"{R}/screening/{NOISY.get(wildcards.set, wildcards.set)}.parquet"
        ),
        library=library("inference.sampling"),
    output:
        f"{R}/posteriors/{{emulator}}/{{set}}/batch-{{batch}}.nc",
    params:
        batches=lambda wildcards: len(posterior_batches(wildcards.set)),
        cases=lambda wildcards: SETS[wildcards.set],
        noise=lambda wildcards: config["scenarios"]["noise"] if wildcards.set in NOISY else None,
        sampler=config["test_posteriors"]["sampler"],
        nuts=config["nuts"],
        map=config["map"],
        seed=config["seed"],
    wildcard_constraints:
        set=any_of(SETS),
    log:
        f"{LOGS}/posteriors/{{emulator}}/{{set}}/batch-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/{{set}}/batch-{{batch}}.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/sample_posteriors.py"


rule summarise_posteriors:
    input:
        posteriors=lambda wildcards: posterior_files(wildcards.emulator, wildcards.set),
        library=library("inference.summaries"),
    output:
        expand(f"{R}/posteriors/{{{{emulator}}}}/{{{{set}}}}/{{table}}", table=SET_TABLES),
    wildcard_constraints:
        set=any_of(SETS),
    log:
        f"{LOGS}/posteriors/{{emulator}}/{{set}}/summarise.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/summarise_posteriors.py"


rule choose_final:
    input:
        emulators=lambda wildcards: expand(
            f"{R}/emulators/{{emulator}}.pt", emulator=shortlist()
        ),
        coverages=lambda wildcards: of_shortlist("coverage.csv"),
        library=library("inference.choice"),
    output:
        emulator=f"{R}/emulators/{EMULATOR}.pt",
        report=f"{R}/posteriors/{EMULATOR}.json",
    params:
        wanted=config["emulators"]["final"],
    log:
        f"{LOGS}/posteriors/choose_final.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/choose_final.py"


rule adopt_test_posteriors:
    """The final emulator's posteriors on the test set are there already, under its own name."""
    input:
        report=f"{R}/posteriors/{EMULATOR}.json",
        posteriors=lambda wildcards: of_shortlist(
            *(f"{batch}.nc" for batch in posterior_batches("test"))
        ),
        tables=lambda wildcards: of_shortlist(*SET_TABLES),
        library=library("inference.choice"),
    output:
        posterior_files(EMULATOR, "test"),
        expand(f"{R}/posteriors/{EMULATOR}/test/{{table}}", table=SET_TABLES),
    log:
        f"{LOGS}/posteriors/adopt_test_posteriors.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/adopt_test_posteriors.py"


ruleorder: adopt_test_posteriors > sample_posteriors
ruleorder: adopt_test_posteriors > summarise_posteriors


rule tell_zones_apart:
    input:
        posteriors=lambda wildcards: posterior_files(wildcards.emulator, wildcards.set),
        library=library("inference.told_apart"),
    output:
        told_apart=f"{R}/posteriors/{{emulator}}/{{set}}/told_apart.csv",
        by_zone=f"{R}/posteriors/{{emulator}}/{{set}}/map_errors_by_zone.csv",
    params:
        healthy=HEALTHY,
    wildcard_constraints:
        set=any_of([*SCENARIOS, *NOISY]),
    log:
        f"{LOGS}/posteriors/{{emulator}}/{{set}}/tell_zones_apart.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/tell_zones_apart.py"


rule measure_separation:
    input:
        told_apart=f"{R}/posteriors/{{emulator}}/{{set}}/told_apart.csv",
        local=lambda wildcards: expand(
            f"{R}/posteriors/{wildcards.emulator}/{{set}}/told_apart.csv",
            set=local_scenarios(noisy=wildcards.set in NOISY),
        ),
        library=library("inference.told_apart"),
    output:
        roc=f"{R}/posteriors/{{emulator}}/{{set}}/roc.csv",
        auc=f"{R}/posteriors/{{emulator}}/{{set}}/auc.csv",
    params:
        seed=config["seed"],
    log:
        f"{LOGS}/posteriors/{{emulator}}/{{set}}/measure_separation.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/measure_separation.py"


rule sample_subject:
    input:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        measured=f"{R}/measured/{{subject}}.csv",
        library=library("inference.sampling"),
    output:
        posterior=f"{R}/posteriors/{{emulator}}/subjects/{{subject}}.nc",
        diagnostics=f"{R}/posteriors/{{emulator}}/subjects/{{subject}}.csv",
    params:
        sampler=config["test_posteriors"]["sampler"],
        nuts=SUBJECT_NUTS,
        map=config["map"],
        noise_prior_scale=config["clinical"]["noise_prior_scale"],
        seed=config["seed"],
    wildcard_constraints:
        subject=any_of(SUBJECTS),
    log:
        f"{LOGS}/posteriors/{{emulator}}/subjects/{{subject}}.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/subjects/{{subject}}.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/sample_subject.py"
