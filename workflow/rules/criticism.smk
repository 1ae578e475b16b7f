"""What the simulation gets wrong, why, and the stiffness averaged over models that doubt it."""

C = f"{R}/criticism"
JOINT = config["criticism"]["joint"]
CRITICISED = [
    *SUBJECTS,
    *(name for name, entry in JOINT.items() if set(entry["subjects"]) <= set(SUBJECTS)),
]
CRITICISM_FIGURES = ["residuals", "causes", "effects", "sources"]
ROUNDS = range(config["criticism"]["confirmation"]["rounds"])


if DOUBTS:
    CRITICISM = settings_of(config)
    STEP = {
        "physics": INPUTS,
        "settings": CRITICISM,
        "seed": config["seed"],
        "subjects": lambda wildcards: criticised(wildcards.subject),
    }
    CRITIC = "hearts.full" if JOINED else "criticism.study"
    if JOINED:
        STEP["channels"] = OUTPUTS
    OF_SUBJECT = {
        "emulator_file": EMULATOR_OF_INPUTS,
        **({"own": f"{OVER_INPUTS}/train.parquet"} if JOINED else {}),
        "measured": lambda wildcards: expand(
            f"{R}/measured/{{subject}}.csv", subject=criticised(wildcards.subject)
        ),
        "known_theta": lambda wildcards: known_theta(wildcards.subject),
    }

    rule plan_confirmation:
        """What has to be simulated of the leading models, round by round. Reads what was measured,
        never a truth."""
        input:
            **OF_SUBJECT,
            simulations=lambda wildcards: confirmations(wildcards.subject, int(wildcards.round)),
        output:
            design=f"{C}/{{subject}}/confirmation/design-{{round}}.parquet",
        log:
            f"{LOGS}/criticism/{{subject}}/plan-{{round}}.log",
        benchmark:
            f"{R}/benchmarks/criticism/{{subject}}/plan-{{round}}.tsv"
        wildcard_constraints:
            subject=any_of(CRITICISED),
        priority: FIRST
        threads: 1
        params:
            **STEP,
            call=f"{CRITIC}:plan_confirmation",
        script:
            "../scripts/call.py"

    rule simulate_models:
        """The leading models at draws of their posterior, with derivatives about all inputs."""
        input:
            mesh=f"{R}/geometry/mesh.vtu",
            predictor=f"{OVER_INPUTS}/predictor.npz",
            design=f"{C}/{{subject}}/confirmation/design-{{round}}.parquet",
        output:
            simulations=f"{C}/{{subject}}/confirmation/simulations-{{round}}.parquet",
        log:
            f"{LOGS}/criticism/{{subject}}/simulate-{{round}}.log",
        benchmark:
            f"{R}/benchmarks/criticism/{{subject}}/simulate-{{round}}.tsv"
        wildcard_constraints:
            subject=any_of(CRITICISED),
        priority: FIRST
        threads: 1
        params:
            call="criticism.confirmation:simulate_round",
            physics=INPUTS,
        script:
            "../scripts/call.py"

    rule conclude_criticism:
        """Posterior averaged over models and verdict, with what the simulations say."""
        input:
            **OF_SUBJECT,
            simulations=lambda wildcards: confirmations(wildcards.subject, len(ROUNDS)),
        output:
            findings=f"{C}/{{subject}}/findings.json",
            posterior=f"{C}/{{subject}}/posterior.nc",
        log:
            f"{LOGS}/criticism/{{subject}}/conclude.log",
        benchmark:
            f"{R}/benchmarks/criticism/{{subject}}/conclude.tsv"
        wildcard_constraints:
            subject=any_of(CRITICISED),
        priority: FIRST
        threads: 1
        params:
            **STEP,
            call=f"{CRITIC}:conclude_criticism",
        script:
            "../scripts/call.py"

    rule plot_criticism:
        """Residuals, causes, their effects, and what the variance of the stiffness comes from."""
        input:
            findings=f"{C}/{{subject}}/findings.json",
        output:
            **{name: f"{C}/{{subject}}/{name}.png" for name in CRITICISM_FIGURES},
            tables=[f"{C}/{{subject}}/{name}.csv" for name in CRITICISM_FIGURES],
        log:
            f"{LOGS}/criticism/{{subject}}/plot.log",
        wildcard_constraints:
            subject=any_of(CRITICISED),
        localrule: True
        params:
            call="plots.criticism:draw",
            parameters=PARAMETER_SPEC,
        script:
            "../scripts/call.py"

    rule extend_study:
        """The study with the named causes switched on, as a configuration of its own."""
        input:
            findings=f"{C}/{{subject}}/findings.json",
        output:
            extended=f"{C}/{{subject}}/extended.yaml",
        log:
            f"{LOGS}/criticism/{{subject}}/extend.log",
        wildcard_constraints:
            subject=any_of(CRITICISED),
        localrule: True
        params:
            call="criticism.extend:write_extended",
            config=config,
        script:
            "../scripts/call.py"


rule criticism:
    """The findings of every subject."""
    input:
        expand(f"{C}/{{subject}}/findings.json", subject=CRITICISED if DOUBTS else []),
