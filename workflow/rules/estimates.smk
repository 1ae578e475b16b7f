"""Point estimates of the test set by every emulator, checked, ranked, and the shortlist.

What is held out beside a test table is estimated, checked and ranked in the same way (`SCORED`); the
shortlist goes by the test set.
"""

ESTIMATES = f"{R}/estimates"
RANKED = config["emulators"]["names"]


rule estimate_parameters:
    input:
        emulator_file=LAYOUT.emulator("{emulator}"),
        test=LAYOUT.screened("{set}"),
    output:
        estimates=LAYOUT.estimates("{emulator}", "{set}"),
    log:
        f"{LOGS}/estimates/{{emulator}}/estimate_{{set}}.log",
    benchmark:
        f"{R}/benchmarks/estimates/{{emulator}}_{{set}}.tsv"
    wildcard_constraints:
        set=any_of(SCORED),
    threads: 1
    params:
        call="paper.estimates.estimate:estimate_parameters",
        point=config["map"],
        adam_steps=config["estimates"]["adam_steps"],
        hops=config["estimates"]["hops"],
        seed=config["seed"],
    script:
        "../scripts/call.py"


rule measure_costs:
    """One after the other in one job, as they are compared."""
    input:
        **{f"{name}.emulator_file": LAYOUT.emulator(name) for name in RANKED},
        **{f"{name}.test": LAYOUT.screened("test") for name in RANKED},
    output:
        **{f"{name}.cost": LAYOUT.estimates_cost(name) for name in RANKED},
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
            screened=expand(LAYOUT.screened("{name}"), name=["train", *SCORED]),
        output:
            reference=f"{ESTIMATES}/reference.pt",
        log:
            f"{LOGS}/estimates/fit_reference.log",
        threads: 1
        params:
            call="paper.estimates.reference:fit_reference",
            parameters=PARAMETER_SPEC,
            channels=OUTPUTS,
            seed=config["seed"],
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
            physics=PHYSICS,
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
        channels=OUTPUTS,
        size=config["emulators"]["shortlist"]["size"],
        estimator=config["emulators"]["shortlist"]["estimator"],
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
        channels=OUTPUTS,
    script:
        "../scripts/call.py"


rule measure_efficiency:
    input:
        train=LAYOUT.screened("train"),
        test=LAYOUT.screened("test"),
    output:
        curve=LAYOUT.efficiency("{emulator}", "{transform}"),
    log:
        f"{LOGS}/efficiency/{{emulator}}-{{transform}}.log",
    benchmark:
        f"{R}/benchmarks/efficiency/{{emulator}}-{{transform}}.tsv"
    wildcard_constraints:
        emulator="exact_gp|gradient_gp",
        transform="log|identity",
    threads: 1
    params:
        call="paper.estimates.efficiency:measure_efficiency",
        settings=lambda wildcards: config["emulators"][wildcards.emulator],
        sizes=config["efficiency"]["sizes"],
        most_with_sensitivities=config["efficiency"]["most_with_sensitivities"],
        parameters=PARAMETER_SPEC,
        channels=OUTPUTS,
        point=config["map"],
        seed=config["seed"],
    script:
        "../scripts/call.py"
