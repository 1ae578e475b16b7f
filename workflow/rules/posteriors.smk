"""Posteriors: of the test set and the scenarios in batches, of every subject, their convergence."""

SET_TABLES = [
    f"{name}.csv"
    for name in (
        *("diagnostics", "recovery", "coverage", "map_mse", "hpd"),
        *("correlations", "zone_correlations"),
    )
]
SCENARIO_TABLES = ["zone_classification.csv", "map_errors_by_zone.csv", "roc.csv", "auc.csv"]
SUMMARIES = (
    [
        *expand(f"{R}/posteriors/{EMULATOR}/test/{{table}}", table=SET_TABLES),
        *expand(
            f"{R}/posteriors/{EMULATOR}/{{set}}/{{table}}",
            set=[*SCENARIOS, *NOISY],
            table=["coverage.csv", *SCENARIO_TABLES],
        ),
        *expand(
            LAYOUT.posteriors(EMULATOR).checked("{table}"),
            table=["sbc", *([] if FROM_TABLES else ["resimulated"])],
        ),
        *expand(
            LAYOUT.posteriors(EMULATOR).of_subject("{subject}_noise_prior", "csv"),
            subject=NOISE_INFERRED,
        ),
    ]
    if EVALUATION
    else []
)


rule sample_posteriors:
    input:
        emulator_file=LAYOUT.emulator("{emulator}"),
        simulations=lambda wildcards: (LAYOUT.screened(NOISY.get(wildcards.set, wildcards.set))),
    output:
        posteriors=LAYOUT.posteriors("{emulator}").batch("{set}", "{batch}"),
    log:
        f"{LOGS}/posteriors/{{emulator}}/{{set}}/batch-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/{{set}}/batch-{{batch}}.tsv"
    wildcard_constraints:
        set=any_of(SETS),
    threads: 1
    params:
        call="paper.posteriors.sets:sample_set_batch",
        set_name=lambda wildcards: wildcards.set,
        batches=lambda wildcards: len(posterior_batches(wildcards.set)),
        cases=lambda wildcards: SETS[wildcards.set],
        noise=lambda wildcards: config["scenarios"]["noise"] if wildcards.set in NOISY else None,
        sampler=config["test_posteriors"]["sampler"],
        nuts=config["nuts"],
        point=config["map"],
        seed=config["seed"],
    script:
        "../scripts/call.py"


rule summarise_posteriors:
    input:
        posteriors=lambda wildcards: posterior_files(wildcards.emulator, "test"),
    output:
        tables=expand(f"{R}/posteriors/{{{{emulator}}}}/test/{{table}}", table=SET_TABLES),
    log:
        f"{LOGS}/posteriors/{{emulator}}/test/summarise.log",
    params:
        call="paper.posteriors.summaries:summarise_posteriors",
    script:
        "../scripts/call.py"


if EVALUATION:

    rule choose_final:
        input:
            candidates=lambda wildcards: expand(LAYOUT.emulator("{emulator}"), emulator=shortlist()),
            coverages=lambda wildcards: of_shortlist("coverage.csv"),
        output:
            emulator_file=LAYOUT.emulator(EMULATOR),
            report=f"{R}/posteriors/{EMULATOR}.json",
        log:
            f"{LOGS}/posteriors/choose_final.log",
        localrule: True
        params:
            call="paper.posteriors.choice:choose_final",
            wanted=config["emulators"]["final"],
        script:
            "../scripts/call.py"

    rule adopt_test_posteriors:
        """The final emulator's posteriors on the test set are there already, under its own name."""
        input:
            report=f"{R}/posteriors/{EMULATOR}.json",
            candidates=lambda wildcards: of_shortlist(
                *(f"{batch}.nc" for batch in posterior_batches("test")), *SET_TABLES
            ),
        output:
            adopted=posterior_files(EMULATOR, "test")
            + expand(f"{R}/posteriors/{EMULATOR}/test/{{table}}", table=SET_TABLES),
        log:
            f"{LOGS}/posteriors/adopt_test_posteriors.log",
        localrule: True
        params:
            call="paper.posteriors.choice:adopt",
        script:
            "../scripts/call.py"

    ruleorder: adopt_test_posteriors > sample_posteriors
    ruleorder: adopt_test_posteriors > summarise_posteriors


if SCENARIOS:
    OF_SCENARIOS = {name: f"{R}/posteriors/{{emulator}}/{name}" for name in [*SCENARIOS, *NOISY]}
    SUMMARISED = {
        "tables": "paper.posteriors.summaries:summarise_posteriors",
        "zones": "paper.posteriors.classification:classify_zones",
    }

    rule summarise_scenarios:
        """All of them in one job, which takes longer to start than for most of them."""
        input:
            **{
                f"{of}/{name}.posteriors": posterior_files("{{emulator}}", name)
                for of in SUMMARISED
                for name in OF_SCENARIOS
            },
        output:
            **{
                f"tables/{name}.tables": [f"{folder}/{table}" for table in SET_TABLES]
                for name, folder in OF_SCENARIOS.items()
            },
            **{
                f"zones/{name}.{key}": f"{folder}/{table}.csv"
                for name, folder in OF_SCENARIOS.items()
                for key, table in {
                    "classified": "zone_classification",
                    "by_zone": "map_errors_by_zone",
                }.items()
            },
        log:
            f"{LOGS}/posteriors/{{emulator}}/summarise_scenarios.log",
        params:
            **{f"zones/{name}.healthy": HEALTHY for name in OF_SCENARIOS},
            calls={f"{of}/{name}": call for of, call in SUMMARISED.items() for name in OF_SCENARIOS},
        script:
            "../scripts/call.py"

    rule score_classification:
        input:
            **{
                f"{name}.classified": f"{folder}/zone_classification.csv"
                for name, folder in OF_SCENARIOS.items()
            },
            **{
                f"{name}.local": [
                    f"{OF_SCENARIOS[local]}/zone_classification.csv"
                    for local in local_scenarios(noisy=name in NOISY)
                ]
                for name in OF_SCENARIOS
            },
        output:
            **{
                f"{name}.{table}": f"{folder}/{table}.csv"
                for name, folder in OF_SCENARIOS.items()
                for table in ("roc", "auc")
            },
        log:
            f"{LOGS}/posteriors/{{emulator}}/score_classification.log",
        localrule: True
        params:
            **{f"{name}.seed": config["seed"] for name in OF_SCENARIOS},
            calls=dict.fromkeys(
                OF_SCENARIOS, "paper.posteriors.classification:score_classification"
            ),
        script:
            "../scripts/call.py"


rule sample_subject:
    input:
        emulator_file=LAYOUT.emulator("{emulator}"),
        measured=LAYOUT.measured("{subject}"),
    output:
        posterior=LAYOUT.posteriors("{emulator}").of_subject("{subject}", "nc"),
        diagnostics=LAYOUT.posteriors("{emulator}").of_subject("{subject}", "csv"),
    log:
        f"{LOGS}/posteriors/{{emulator}}/subjects/{{subject}}.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/subjects/{{subject}}.tsv"
    wildcard_constraints:
        subject=any_of(SUBJECTS),
    threads: 1
    params:
        call="inference.sampling:sample_subject",
        sampler=config["test_posteriors"]["sampler"],
        nuts=SUBJECT_NUTS,
        point=config["map"],
        noise_prior_scale=config["clinical"]["noise_prior_scale"],
        seed=config["seed"],
    script:
        "../scripts/call.py"
