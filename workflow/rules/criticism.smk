"""What the simulation gets wrong, why, and the stiffness averaged over models."""

C = f"{R}/criticism"
JOINT = config["criticism"]["joint"]
CRITICISED = [
    *SUBJECTS,
    *(name for name, entry in JOINT.items() if set(entry["subjects"]) <= set(SUBJECTS)),
]
# Criticisms of several subjects together.
TOGETHER = [name for name in CRITICISED if name in JOINT]
CRITICISM_FIGURES = ["residuals", "causes", "effects", "sources"]
CRITICISM = settings_of(config)
if FROM_TABLES:
    CRITICISE, SIMULATOR = "criticism.study:criticise_by_emulator", {}
else:
    CRITICISE = f"{'hearts.full' if JOINED else 'criticism.study'}:criticise_subject"
    SIMULATOR = {"mesh": LAYOUT.heart().mesh, "predictor": LAYOUT.inputs_predictor()}


rule criticise_subject:
    """Search, simulations of the leading models with derivatives with respect to all inputs
    until the emulator agrees with them, posterior averaged over models, verdict. Reads what was
    measured, never a truth."""
    input:
        given(DESCRIBED) if JOINED else [],
        **({"own": LAYOUT.inputs_screened("train")} if JOINED else {}),
        **SIMULATOR,
        emulator_file=EMULATOR_OF_INPUTS,
        measured=lambda wildcards: expand(
            LAYOUT.measured("{subject}"), subject=criticised(wildcards.subject)
        ),
        known_theta=lambda wildcards: known_theta(wildcards.subject),
    output:
        **({"simulations": f"{C}/{{subject}}/confirmation.parquet"} if SIMULATOR else {}),
        findings=LAYOUT.findings("{subject}"),
        posterior=LAYOUT.posterior("{subject}"),
    log:
        f"{LOGS}/criticism/{{subject}}/criticise.log",
    benchmark:
        f"{R}/benchmarks/criticism/{{subject}}.tsv"
    wildcard_constraints:
        subject=any_of(CRITICISED),
    priority: FIRST
    threads: 1
    resources:
        **needs(mem_mb=3000, minutes=60),
    params:
        **({"channels": OUTPUTS} if JOINED else {}),
        call=CRITICISE,
        physics=INPUTS,
        settings=CRITICISM,
        seed=config["seed"],
        subjects=lambda wildcards: criticised(wildcards.subject),
    script:
        "../scripts/call.py"


rule extend_study:
    """The study with the named causes switched on, as a configuration of its own."""
    input:
        findings=LAYOUT.findings("{subject}"),
    output:
        extended=LAYOUT.extended("{subject}"),
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
        expand(LAYOUT.findings("{subject}"), subject=CRITICISED),
