"""What the simulation gets wrong, why, and the stiffness averaged over models that doubt it."""

C = f"{R}/criticism"
JOINT = config["criticism"]["joint"]
CRITICISED = [
    *SUBJECTS,
    *(name for name, entry in JOINT.items() if set(entry["subjects"]) <= set(SUBJECTS)),
]
# Criticisms of several subjects together.
TOGETHER = [name for name in CRITICISED if name in JOINT] if DOUBTS else []
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

    rule confirm_models:
        """One round: the leading models at draws of their posterior, with derivatives about all
        inputs; none where the rounds before were enough. Reads what was measured, never a truth.
        """
        input:
            **OF_SUBJECT,
            mesh=f"{R}/geometry/mesh.vtu",
            predictor=f"{OVER_INPUTS}/predictor.npz",
            earlier=lambda wildcards: confirmations(wildcards.subject, int(wildcards.round)),
        output:
            simulations=f"{C}/{{subject}}/confirmation/simulations-{{round}}.parquet",
        log:
            f"{LOGS}/criticism/{{subject}}/confirm-{{round}}.log",
        benchmark:
            f"{R}/benchmarks/criticism/{{subject}}/confirm-{{round}}.tsv"
        wildcard_constraints:
            subject=any_of(CRITICISED),
        priority: FIRST
        threads: 1
        params:
            **STEP,
            call=f"{CRITIC}:confirm_models",
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
