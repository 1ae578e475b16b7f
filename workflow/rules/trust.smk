"""Checks of the inference: samplers, calibration, the emulator at posterior draws, noise priors."""


rule compare_samplers:
    input:
        emulator_file=LAYOUT.emulator("{emulator}"),
        posteriors=lambda wildcards: posterior_files(wildcards.emulator, wildcards.set),
    output:
        table=LAYOUT.posteriors("{emulator}").of_set("{set}", "sampler_agreement"),
    log:
        f"{LOGS}/posteriors/{{emulator}}/{{set}}/compare_samplers.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/{{set}}/compare_samplers.tsv"
    wildcard_constraints:
        set=any_of(SETS),
    threads: 1
    resources:
        **needs(mem_mb=3000, minutes=480),
    params:
        call="paper.posteriors.agreement:compare_samplers",
        set_name=lambda wildcards: wildcards.set,
        cases=config["trust"]["agreement_cases"],
        noise=lambda wildcards: config["scenarios"]["noise"] if wildcards.set in NOISY else None,
    script:
        "../scripts/call.py"


rule compare_subject:
    input:
        emulator_file=LAYOUT.emulator("{emulator}"),
        measured=LAYOUT.measured("{subject}"),
        posterior=LAYOUT.posteriors("{emulator}").of_subject("{subject}", "nc"),
    output:
        table=LAYOUT.posteriors("{emulator}").of_subject("{subject}_sampler_agreement", "csv"),
    log:
        f"{LOGS}/posteriors/{{emulator}}/subjects/{{subject}}_sampler_agreement.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/subjects/{{subject}}_sampler_agreement.tsv"
    wildcard_constraints:
        subject=any_of(SUBJECTS),
    threads: 1
    resources:
        **needs(mem_mb=3000, minutes=240),
    params:
        call="paper.posteriors.agreement:compare_subject",
        nuts=SUBJECT_NUTS,
        noise_prior_scale=config["clinical"]["noise_prior_scale"],
    script:
        "../scripts/call.py"


rule calibrate_chain:
    input:
        emulator_file=LAYOUT.emulator("{emulator}"),
        simulations=LAYOUT.screened("train"),
    output:
        ranks=LAYOUT.posteriors("{emulator}").checked("sbc_ranks"),
        histogram=LAYOUT.posteriors("{emulator}").checked("sbc"),
        tests=LAYOUT.posteriors("{emulator}").checked("sbc_test"),
    log:
        f"{LOGS}/posteriors/{{emulator}}/calibrate_chain.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/calibrate_chain.tsv"
    threads: 1
    resources:
        **needs(mem_mb=3000, minutes=240),
    params:
        call="paper.posteriors.rank_calibration:calibrate_chain",
        cases=config["trust"]["calibration_cases"],
    script:
        "../scripts/call.py"


rule pick_draws:
    input:
        posteriors=lambda wildcards: posterior_files(EMULATOR, "test"),
    output:
        design=LAYOUT.design("resimulated"),
    log:
        f"{LOGS}/design/pick_draws.log",
    localrule: True
    params:
        call="paper.posteriors.resimulation:pick_draws",
        cases=config["trust"]["resimulated_cases"],
        draws=config["trust"]["resimulated_draws"],
    script:
        "../scripts/call.py"


rule resimulate_draws:
    """Screened, and compared with the emulator."""
    input:
        batches=expand(
            LAYOUT.simulations("resimulated", "{batch}"),
            batch=SIMULATION_BATCHES["resimulated"],
        ),
        emulator_file=LAYOUT.emulator(EMULATOR),
        test=LAYOUT.screened("test"),
    output:
        **{
            "screened.kept": LAYOUT.screened("resimulated"),
            "screened.excluded": LAYOUT.excluded("resimulated"),
            "screened.summary": LAYOUT.screening_summary("resimulated"),
            "compared.table": LAYOUT.posteriors(EMULATOR).checked("resimulated"),
            "compared.summary": LAYOUT.posteriors(EMULATOR).checked("resimulated_summary"),
        },
    log:
        f"{LOGS}/posteriors/resimulate_draws.log",
    localrule: True
    params:
        calls={
            "screened": "simulation.screening:screen_simulations",
            "compared": "paper.posteriors.resimulation:compare_resimulated",
        },
        simulations=written("screened.kept"),
    script:
        "../scripts/call.py"


rule sample_noise_prior:
    """A subject's posterior once more, with another prior on its noise."""
    input:
        emulator_file=LAYOUT.emulator("{emulator}"),
        measured=LAYOUT.measured("{subject}"),
    output:
        posterior=f"{R}/posteriors/{{emulator}}/subjects/noise_prior/{{subject}}-{{scale}}.nc",
        diagnostics=f"{R}/posteriors/{{emulator}}/subjects/noise_prior/{{subject}}-{{scale}}.csv",
    log:
        f"{LOGS}/posteriors/{{emulator}}/subjects/noise_prior/{{subject}}-{{scale}}.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/subjects/noise_prior/{{subject}}-{{scale}}.tsv"
    wildcard_constraints:
        subject=any_of(NOISE_INFERRED),
    threads: 1
    resources:
        **needs(mem_mb=3000, minutes=120),
    params:
        call="paper.sampler.sampling:sample_subject",
        nuts=SUBJECT_NUTS,
        noise_prior_scale=lambda wildcards: float(wildcards.scale),
    script:
        "../scripts/call.py"


rule compare_noise_priors:
    input:
        posteriors=noise_prior_posteriors,
    output:
        table=LAYOUT.posteriors("{emulator}").of_subject("{subject}_noise_prior", "csv"),
    log:
        f"{LOGS}/posteriors/{{emulator}}/subjects/{{subject}}_noise_prior.log",
    wildcard_constraints:
        subject=any_of(NOISE_INFERRED),
    localrule: True
    params:
        call="paper.posteriors.noise_prior:compare_noise_priors",
        scales=config["clinical"]["noise_prior_scales"],
    script:
        "../scripts/call.py"
