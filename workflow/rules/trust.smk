"""Checks of the inference: samplers, calibration, the emulator at posterior draws, noise priors."""


rule compare_samplers:
    input:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        posteriors=lambda wildcards: posterior_files(wildcards.emulator, "test"),
        library=library("inference.agreement"),
    output:
        f"{R}/posteriors/{{emulator}}/sampler_agreement.csv",
    params:
        cases=config["trust"]["agreement_cases"],
        nuts=config["nuts"],
        map=config["map"],
        seed=config["seed"],
    log:
        f"{LOGS}/posteriors/{{emulator}}/compare_samplers.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/compare_samplers.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/compare_samplers.py"


rule calibrate_chain:
    input:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        simulations=f"{R}/screening/train.parquet",
        library=library("inference.calibration"),
    output:
        ranks=f"{R}/posteriors/{{emulator}}/sbc_ranks.csv",
        histogram=f"{R}/posteriors/{{emulator}}/sbc.csv",
        tests=f"{R}/posteriors/{{emulator}}/sbc_test.csv",
    params:
        cases=config["trust"]["calibration_cases"],
        sampler=config["test_posteriors"]["sampler"],
        nuts=config["nuts"],
        map=config["map"],
        seed=config["seed"],
    log:
        f"{LOGS}/posteriors/{{emulator}}/calibrate_chain.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/calibrate_chain.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/calibrate_chain.py"


rule pick_draws:
    input:
        posteriors=lambda wildcards: posterior_files(EMULATOR, "test"),
        library=library("inference.resimulation"),
    output:
        f"{R}/design/resimulated.parquet",
    params:
        cases=config["trust"]["resimulated_cases"],
        draws=config["trust"]["resimulated_draws"],
        seed=config["seed"],
    log:
        f"{LOGS}/design/pick_draws.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/pick_draws.py"


rule resimulate_draws:
    input:
        emulator=f"{R}/emulators/{EMULATOR}.pt",
        simulations=f"{R}/screening/resimulated.parquet",
        test=f"{R}/screening/test.parquet",
        library=library("inference.resimulation"),
    output:
        table=f"{R}/posteriors/{EMULATOR}/resimulated.csv",
        summary=f"{R}/posteriors/{EMULATOR}/resimulated_summary.csv",
    log:
        f"{LOGS}/posteriors/resimulate_draws.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/resimulate_draws.py"


rule sample_noise_prior:
    """A subject's posterior once more, with another prior on its noise."""
    input:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        measured=f"{R}/measured/{{subject}}.csv",
        library=library("inference.sampling"),
    output:
        posterior=f"{R}/posteriors/{{emulator}}/subjects/noise_prior/{{subject}}-{{scale}}.nc",
        diagnostics=f"{R}/posteriors/{{emulator}}/subjects/noise_prior/{{subject}}-{{scale}}.csv",
    params:
        sampler=config["test_posteriors"]["sampler"],
        nuts=SUBJECT_NUTS,
        map=config["map"],
        noise_prior_scale=lambda wildcards: float(wildcards.scale),
        seed=config["seed"],
    wildcard_constraints:
        subject=any_of(NOISE_INFERRED),
    log:
        f"{LOGS}/posteriors/{{emulator}}/subjects/noise_prior/{{subject}}-{{scale}}.log",
    benchmark:
        f"{R}/benchmarks/posteriors/{{emulator}}/subjects/noise_prior/{{subject}}-{{scale}}.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/sample_subject.py"


rule compare_noise_priors:
    input:
        posteriors=noise_prior_posteriors,
        library=library("inference.noise_prior"),
    output:
        f"{R}/posteriors/{{emulator}}/subjects/{{subject}}_noise_prior.csv",
    params:
        scales=config["clinical"]["noise_prior_scales"],
    wildcard_constraints:
        subject=any_of(NOISE_INFERRED),
    log:
        f"{LOGS}/posteriors/{{emulator}}/subjects/{{subject}}_noise_prior.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/compare_noise_priors.py"
