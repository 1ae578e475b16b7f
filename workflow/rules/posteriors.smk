"""Posteriors: of the test set and the scenarios in batches, of every subject, their convergence."""

from regional_lv.paper.posteriors.files import TABLES as OF_SET  # noqa: E402

SET_TABLES = [f"{name}.csv" for name in OF_SET]
# What there is of an emulator on the test set.
OF_TEST_SET = [
    *(
        f"{R}/posteriors/{{emulator}}/test/{file}"
        for file in (*(f"batch-{batch}.nc" for batch in posterior_batches("test")), *SET_TABLES)
    ),
    *(f"{R}/emulators/{{emulator}}/test_{file}" for file in ("predictions.parquet", "errors.csv")),
]
SCENARIO_TABLES = ["zone_classification.csv", "roc.csv", "auc.csv"]
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
    resources:
        **needs(mem_mb=3000, minutes=240),
    params:
        call="paper.posteriors.sets:sample_set_batch",
        set_name=lambda wildcards: wildcards.set,
        batches=lambda wildcards: len(posterior_batches(wildcards.set)),
        cases=lambda wildcards: SETS[wildcards.set],
        noise=lambda wildcards: config["scenarios"]["noise"] if wildcards.set in NOISY else None,
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
        """What there is of the test set by the chosen emulator is copied with it."""
        input:
            candidates=lambda wildcards: expand(LAYOUT.emulator("{emulator}"), emulator=shortlist()),
            coverages=lambda wildcards: of_shortlist("coverage.csv"),
            made=lambda wildcards: expand(OF_TEST_SET, emulator=shortlist()),
        output:
            emulator_file=LAYOUT.emulator(EMULATOR),
            report=f"{R}/posteriors/{EMULATOR}.json",
            adopted=expand(OF_TEST_SET, emulator=EMULATOR),
        log:
            f"{LOGS}/posteriors/choose_final.log",
        localrule: True
        params:
            call="paper.posteriors.choice:choose_final",
            wanted=config["emulators"]["final"],
        script:
            "../scripts/call.py"

    ruleorder: choose_final > sample_posteriors
    ruleorder: choose_final > summarise_posteriors
    ruleorder: choose_final > judge_emulator


if SCENARIOS:
    OF_SCENARIOS = {name: f"{R}/posteriors/{{emulator}}/{name}" for name in [*SCENARIOS, *NOISY]}
    SUMMARISED = {
        "tables": "paper.posteriors.summaries:summarise_posteriors",
        "zones": "paper.posteriors.classification:classify_zones",
        "scores": "paper.posteriors.classification:score_classification",
    }

    rule summarise_scenarios:
        """All of them in one job, which takes longer to start than for most of them."""
        input:
            **{
                f"{of}/{name}.posteriors": posterior_files("{{emulator}}", name)
                for of in ("tables", "zones")
                for name in OF_SCENARIOS
            },
        output:
            **{
                f"{call}.{key}": files
                for name, folder in OF_SCENARIOS.items()
                for call, made in {
                    f"tables/{name}": {"tables": [f"{folder}/{table}" for table in SET_TABLES]},
                    f"zones/{name}": {"classified": f"{folder}/zone_classification.csv"},
                    f"scores/{name}": {table: f"{folder}/{table}.csv" for table in ("roc", "auc")},
                }.items()
                for key, files in made.items()
            },
        log:
            f"{LOGS}/posteriors/{{emulator}}/summarise_scenarios.log",
        params:
            **{
                f"scores/{name}.classified": written(f"zones/{name}.classified")
                for name in OF_SCENARIOS
            },
            **{
                f"scores/{name}.local": written(
                    [f"zones/{local}.classified" for local in local_scenarios(name in NOISY)]
                )
                for name in OF_SCENARIOS
            },
            calls={f"{of}/{name}": call for of, call in SUMMARISED.items() for name in OF_SCENARIOS},
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
    resources:
        **needs(mem_mb=3000, minutes=120),
    params:
        call="paper.sampler.sampling:sample_subject",
        nuts=SUBJECT_NUTS,
        noise_prior_scale=config["clinical"]["noise_prior_scale"],
    script:
        "../scripts/call.py"
