"""Measured files: of synthetic subjects, of published ones, and the user's own."""


rule simulate_subject:
    """The only rule that writes a truth; no rule that infers reads it."""
    input:
        mesh=ventricle_of,
    output:
        measured=LAYOUT.measured("{subject}"),
        truth=LAYOUT.truth("{subject}"),
    log:
        f"{LOGS}/subjects/simulate_{{subject}}.log",
    wildcard_constraints:
        subject=subjects_from("synthetic"),
    priority: FIRST
    params:
        call="simulation.subjects:simulate_subject",
        name=lambda wildcards: wildcards.subject,
        physics=model_sections_of(config),
        subject=lambda wildcards: config["synthetic_subjects"][wildcards.subject],
        seed=lambda wildcards: study_config.seed_of_subject(config, wildcards.subject),
    script:
        "../scripts/call.py"


rule import_volunteer:
    input:
        unpack(volunteer_files),
    output:
        measured=LAYOUT.measured("{subject}"),
    log:
        f"{LOGS}/subjects/import_{{subject}}.log",
    wildcard_constraints:
        subject=subjects_from("published_volunteer"),
    localrule: True
    params:
        call="paper.measured:import_volunteer",
        frame=lambda wildcards: config["subjects"][wildcards.subject]["frame"],
        chosen=lambda wildcards: config["subjects"][wildcards.subject]["slices"],
    script:
        "../scripts/call.py"


rule import_published_simulation:
    """A simulation of the paper as if it had been measured; its theta is known, and kept apart."""
    input:
        inputs=LAYOUT.published(TRAINING_INPUTS),
        outputs=LAYOUT.published(TRAINING_OUTPUTS),
    output:
        measured=LAYOUT.measured("{subject}"),
        theta=LAYOUT.known_theta("{subject}"),
    log:
        f"{LOGS}/subjects/import_{{subject}}.log",
    wildcard_constraints:
        subject=subjects_from("published_simulation"),
    localrule: True
    params:
        call="paper.measured:import_published_simulation",
        row=lambda wildcards: config["subjects"][wildcards.subject]["row"],
    script:
        "../scripts/call.py"


rule import_measured:
    """A subject of the user's: checked, then written in the units used inside."""
    input:
        file=lambda wildcards: given(config["subjects"][wildcards.subject]["measured"]),
    output:
        measured=LAYOUT.measured("{subject}"),
    log:
        f"{LOGS}/subjects/import_{{subject}}.log",
    wildcard_constraints:
        subject=subjects_from("file"),
    localrule: True
    params:
        call="measured.tables:import_measured",
        segments=lambda wildcards: config["subjects"][wildcards.subject]["segments"],
    script:
        "../scripts/call.py"


rule import_curves:
    """A subject of the user's: strain curves, turned into strains that look back."""
    input:
        curves=lambda wildcards: given(config["subjects"][wildcards.subject]["curves"]),
    output:
        measured=LAYOUT.measured("{subject}"),
    log:
        f"{LOGS}/subjects/import_{{subject}}.log",
    wildcard_constraints:
        subject=subjects_from("curves"),
    localrule: True
    params:
        call="measured.curves:import_curves",
        subject=lambda wildcards: config["subjects"][wildcards.subject],
    script:
        "../scripts/call.py"
