"""Point estimates of the test set by every emulator, checked, ranked, and the shortlist.

What is held out beside a test table is estimated, checked and ranked in the same way (`SCORED`); the
shortlist goes by the test set.
"""

RANKED = config["emulators"]["names"]


rule measure_costs:
    """One after the other in one job, as they are compared."""
    input:
        **{f"{name}.emulator_file": f"{R}/emulators/{name}.pt" for name in RANKED},
        test=f"{R}/screening/test.parquet",
    output:
        **{f"{name}.cost": f"{ESTIMATES}/{name}/cost.json" for name in RANKED},
    log:
        f"{LOGS}/estimates/measure_costs.log",
    threads: 1
    params:
        calls=dict.fromkeys(RANKED, "paper.estimates.estimate:measure_cost"),
    script:
        "../scripts/call.py"


if FROM_TABLES:

    rule fit_reference:
        """In place of the simulator, which is not there."""
        input:
            screened=expand(f"{R}/screening/{{name}}.parquet", name=["train", *SCORED]),
        output:
            reference=f"{ESTIMATES}/reference.pt",
        log:
            f"{LOGS}/estimates/fit_reference.log",
        threads: 1
        params:
            call="paper.estimates.reference:fit_reference",
        script:
            "../scripts/call.py"

    rule predict_estimates:
        input:
            reference=f"{ESTIMATES}/reference.pt",
            estimates=f"{ESTIMATES}/{{emulator}}/{{set}}.parquet",
        output:
            checked=f"{ESTIMATES}/{{emulator}}/{{set}}_checked.parquet",
        log:
            f"{LOGS}/estimates/{{emulator}}/predict_{{set}}.log",
        wildcard_constraints:
            set=any_of(SCORED),
        threads: 1
        params:
            call="paper.estimates.reference:predict_estimates",
            cases=config["estimates"]["checked_cases"],
        script:
            "../scripts/call.py"

else:

    rule simulate_estimates:
        input:
            mesh=f"{R}/geometry/mesh.vtu",
            predictor=f"{R}/mechanics/predictor.npz",
            estimates=f"{ESTIMATES}/{{emulator}}/test.parquet",
        output:
            checked=f"{ESTIMATES}/{{emulator}}/test_checked.parquet",
        log:
            f"{LOGS}/estimates/{{emulator}}/simulate_estimates.log",
        benchmark:
            f"{R}/benchmarks/estimates/{{emulator}}_simulated.tsv"
        threads: 1
        params:
            call="paper.estimates.check:simulate_estimates",
            cases=config["estimates"]["checked_cases"],
        script:
            "../scripts/call.py"


checkpoint rank_emulators:
    input:
        **to_rank("test"),
    output:
        # The first one is what Snakemake asks for while others wait for the checkpoint: if another
        # one stood there, a shortlist that is missing would not be made again.
        shortlist=SHORTLIST,
        ranking=f"{ESTIMATES}/ranking.csv",
        pairs=f"{ESTIMATES}/pairs.csv",
    log:
        f"{LOGS}/estimates/rank_emulators.log",
    localrule: True
    params:
        call="paper.estimates.ranking:rank_emulators",
        names=RANKED,
        size=config["emulators"]["shortlist"]["size"],
        estimator=config["emulators"]["shortlist"]["estimator"],
    script:
        "../scripts/call.py"


if "holdout" in SCORED:

    use rule rank_emulators as rank_emulators_on_holdout with:
        input:
            **to_rank("holdout"),
        output:
            ranking=f"{ESTIMATES}/holdout_ranking.csv",
            pairs=f"{ESTIMATES}/holdout_pairs.csv",
        log:
            f"{LOGS}/estimates/rank_emulators_on_holdout.log",


rule compare_transforms:
    input:
        estimates=expand(f"{ESTIMATES}/{{emulator}}/test.parquet", emulator=EMULATORS),
        predictions=expand(
            f"{R}/emulators/{{emulator}}/test_predictions.parquet", emulator=EMULATORS
        ),
        train=f"{R}/screening/train.parquet",
    output:
        comparison=f"{ESTIMATES}/transforms.csv",
    log:
        f"{LOGS}/estimates/compare_transforms.log",
    localrule: True
    params:
        call="paper.estimates.transforms:compare_transforms",
        transforms=TRANSFORMS,
        files=list(EMULATORS),
    script:
        "../scripts/call.py"


rule measure_efficiency:
    """With the inputs on either scale."""
    input:
        train=f"{R}/screening/train.parquet",
        test=f"{R}/screening/test.parquet",
    output:
        **{f"{scale}.curve": f"{R}/efficiency/{{emulator}}-{scale}.csv" for scale in SCALES},
    log:
        f"{LOGS}/efficiency/{{emulator}}.log",
    benchmark:
        f"{R}/benchmarks/efficiency/{{emulator}}.tsv"
    wildcard_constraints:
        emulator="exact_gp|gradient_gp",
    threads: 1
    params:
        **{f"{scale}.transform": scale for scale in SCALES},
        calls=dict.fromkeys(SCALES, "paper.estimates.efficiency:measure_efficiency"),
        settings=lambda wildcards: config["emulators"][wildcards.emulator],
        sizes=config["efficiency"]["sizes"],
        most_with_sensitivities=config["efficiency"]["most_with_sensitivities"],
    script:
        "../scripts/call.py"
