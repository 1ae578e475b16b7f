"""Measured files: of synthetic subjects, of published ones, and the user's own."""

rule simulate_subject:
    """The only rule that writes a truth; no rule that infers reads it."""
    input:
        mesh=f"{R}/geometry/mesh.vtu",
        predictor=f"{R}/mechanics/predictor.npz",
        library=library("subjects"),
    output:
        measured=f"{R}/measured/{{subject}}.csv",
        truth=f"{R}/truth/{{subject}}.json",
    params:
        physics=PHYSICS,
        subject=lambda wildcards: config["synthetic_subjects"][wildcards.subject],
        seed=lambda wildcards: subject_seed(wildcards.subject),
    wildcard_constraints:
        subject=subjects_from("synthetic"),
    log:
        f"{LOGS}/subjects/simulate_{{subject}}.log",
    conda:
        "../../envs/mechanics.yaml"
    script:
        "../scripts/simulate_subject.py"


rule fetch_volunteer:
    """Where the file was found is no parameter: its content cannot differ (checksum)."""
    input:
        library=library("resources"),
    output:
        fetched_path(config["study"], VOLUNTEER),
    log:
        f"{LOGS}/subjects/fetch_volunteer.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/fetch_volunteer.py"


rule import_volunteer:
    input:
        unpack(volunteer_files),
        library=library("measured"),
    output:
        f"{R}/measured/{{subject}}.csv",
    params:
        frame=lambda wildcards: config["subjects"][wildcards.subject]["frame"],
        slices=lambda wildcards: config["subjects"][wildcards.subject]["slices"],
    wildcard_constraints:
        subject=subjects_from("published_volunteer"),
    log:
        f"{LOGS}/subjects/import_{{subject}}.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/import_volunteer.py"


rule import_published_simulation:
    """A simulation of the paper as if it had been measured; its theta is known, and kept apart."""
    input:
        inputs=fetched_path(config["study"], TRAINING_INPUTS),
        outputs=fetched_path(config["study"], TRAINING_OUTPUTS),
        library=library("measured"),
    output:
        measured=f"{R}/measured/{{subject}}.csv",
        theta=f"{R}/known_theta/{{subject}}.csv",
    params:
        row=lambda wildcards: config["subjects"][wildcards.subject]["row"],
    wildcard_constraints:
        subject=subjects_from("published_simulation"),
    log:
        f"{LOGS}/subjects/import_{{subject}}.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/import_published_simulation.py"


rule import_measured:
    """A subject of the user's: checked, then written in the units used inside."""
    input:
        measured=lambda wildcards: config["subjects"][wildcards.subject]["measured"],
        library=library("measured"),
    output:
        f"{R}/measured/{{subject}}.csv",
    wildcard_constraints:
        subject=subjects_from("file"),
    log:
        f"{LOGS}/subjects/import_{{subject}}.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/import_measured.py"
