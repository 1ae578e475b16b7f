"""Point estimates of the test set by every emulator, checked, ranked, and the shortlist.

What is held out beside a test table is estimated, checked and ranked in the same way (`SCORED`); the
shortlist goes by the test set.
"""

RANKED = config["emulators"]["names"]


rule measure_costs:
    """One after the other in one job, as they are compared."""
    input:
        **{f"{name}.emulator_file": LAYOUT.emulator(name) for name in RANKED},
        test=LAYOUT.screened("test"),
    output:
        **{f"{name}.cost": LAYOUT.estimates_cost(name) for name in RANKED},
    log:
        f"{LOGS}/estimates/measure_costs.log",
    threads: 1
    resources:
        **needs(mem_mb=4000),
    params:
        calls=dict.fromkeys(RANKED, "paper.estimates.estimate:measure_cost"),
    script:
        "../scripts/call.py"


if FROM_TABLES:

    rule fit_reference:
        """In place of the simulator, which is not there."""
        input:
            screened=expand(LAYOUT.screened("{name}"), name=["train", *SCORED]),
        output:
            reference=f"{ESTIMATES}/reference.pt",
        log:
            f"{LOGS}/estimates/fit_reference.log",
        threads: 1
        resources:
            **needs(mem_mb=4000, minutes=120),
        params:
            call="paper.estimates.reference:fit_reference",
        script:
            "../scripts/call.py"

    rule predict_estimates:
        input:
            reference=f"{ESTIMATES}/reference.pt",
            estimates=LAYOUT.estimates("{emulator}", "{set}"),
        output:
            checked=LAYOUT.estimates_checked("{emulator}", "{set}"),
        log:
            f"{LOGS}/estimates/{{emulator}}/predict_{{set}}.log",
        wildcard_constraints:
            set=any_of(SCORED),
        threads: 1
        resources:
            **needs(mem_mb=4000),
        params:
            call="paper.estimates.reference:predict_estimates",
            cases=config["estimates"]["checked_cases"],
        script:
            "../scripts/call.py"

else:

    rule simulate_estimates:
        input:
            mesh=LAYOUT.heart().mesh,
            predictor=LAYOUT.predictor(),
            estimates=LAYOUT.estimates("{emulator}", "test"),
        output:
            checked=LAYOUT.estimates_checked("{emulator}", "test"),
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
        ranking=LAYOUT.compared("ranking"),
        pairs=LAYOUT.compared("pairs"),
    log:
        f"{LOGS}/estimates/rank_emulators.log",
    localrule: True
    params:
        call="paper.estimates.ranking:rank_emulators",
        names=RANKED,
        size=config["emulators"]["shortlist"]["size"],
        estimator=config["emulators"]["shortlist"]["estimator"],
        named=config["emulators"]["shortlist"]["names"],
        also=[*config["emulators"]["shortlist"]["also"], config["emulators"]["final"]],
    script:
        "../scripts/call.py"


if "holdout" in SCORED:

    use rule rank_emulators as rank_emulators_on_holdout with:
        input:
            **to_rank("holdout"),
        output:
            ranking=LAYOUT.compared("holdout_ranking"),
            pairs=LAYOUT.compared("holdout_pairs"),
        log:
            f"{LOGS}/estimates/rank_emulators_on_holdout.log",


rule compare_transforms:
    input:
        estimates=expand(LAYOUT.estimates("{emulator}", "test"), emulator=EMULATORS),
        predictions=expand(LAYOUT.predictions("{emulator}", "test"), emulator=EMULATORS),
        train=LAYOUT.screened("train"),
    output:
        comparison=LAYOUT.compared("transforms"),
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
        train=LAYOUT.screened("train"),
        test=LAYOUT.screened("test"),
    output:
        **{f"{scale}.curve": LAYOUT.efficiency("{emulator}", scale) for scale in SCALES},
    log:
        f"{LOGS}/efficiency/{{emulator}}.log",
    benchmark:
        f"{R}/benchmarks/efficiency/{{emulator}}.tsv"
    wildcard_constraints:
        emulator="exact_gp|gradient_gp",
    threads: 1
    resources:
        **needs(mem_mb=4000, minutes=120),
    params:
        **{f"{scale}.transform": scale for scale in SCALES},
        calls=dict.fromkeys(SCALES, "paper.estimates.efficiency:measure_efficiency"),
        settings=lambda wildcards: config["emulators"][wildcards.emulator],
        sizes=config["efficiency"]["sizes"],
        most_with_sensitivities=config["efficiency"]["most_with_sensitivities"],
    script:
        "../scripts/call.py"
