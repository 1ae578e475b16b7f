"""Figures and tables: everything that a reader looks at, each figure with its data beside it."""

POSTERIORS = f"{R}/posteriors/{EMULATOR}"
SUBJECT_FIGURES = ["bullseye_posterior", "posterior_predictive", "traces"]
FIGURES = expand(
    f"{R}/figures/{{name}}.{{ext}}",
    name=([] if FROM_TABLES else ["zones", "design"])
    + ["explained_variance", "parity", "recovery", *COMPARISON_FIGURES],
    ext=["png", "csv"],
) + expand(
    f"{R}/figures/{{subject}}/{{name}}.{{ext}}",
    subject=SUBJECTS,
    name=SUBJECT_FIGURES,
    ext=["png", "csv"],
)
TABLES = expand(
    f"{R}/tables/{{name}}.{{ext}}",
    name=["diagnostics", "recovery", *COMPARISON_TABLES] + (["subjects"] if SUBJECTS else []),
    ext=["csv", "tex"],
)
TRUTHS = {subject: f"{R}/truth/{subject}.json" for subject in SYNTHETIC}


rule plot_zones:
    input:
        mesh=f"{R}/geometry/mesh.vtu",
        library=library("figures.zones"),
    output:
        png=report(
            f"{R}/figures/zones.png", caption="../report/zones.rst", category="Geometry"
        ),
        csv=f"{R}/figures/zones.csv",
    log:
        f"{LOGS}/figures/zones.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_zones.py"


rule plot_design:
    input:
        simulations=f"{R}/screening/train.parquet",
        excluded=f"{R}/screening/train_excluded.csv",
        library=library("figures.design"),
    output:
        png=report(
            f"{R}/figures/design.png", caption="../report/design.rst", category="Simulations"
        ),
        csv=f"{R}/figures/design.csv",
    log:
        f"{LOGS}/figures/design.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_design.py"


rule plot_explained_variance:
    input:
        explained=f"{R}/reduction/explained_variance.csv",
        library=library("figures.explained_variance"),
    output:
        png=report(
            f"{R}/figures/explained_variance.png",
            caption="../report/explained_variance.rst",
            category="Emulator",
        ),
        csv=f"{R}/figures/explained_variance.csv",
    params:
        threshold=config["reduction"]["explained_variance"],
    log:
        f"{LOGS}/figures/explained_variance.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_explained_variance.py"


rule plot_parity:
    input:
        predictions=f"{R}/emulators/{EMULATOR}/test_predictions.parquet",
        library=library("figures.parity"),
    output:
        png=report(
            f"{R}/figures/parity.png", caption="../report/parity.rst", category="Emulator"
        ),
        csv=f"{R}/figures/parity.csv",
    params:
        emulator=EMULATOR,
    log:
        f"{LOGS}/figures/parity.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_parity.py"


rule plot_recovery:
    input:
        recovery=f"{POSTERIORS}/test/recovery.csv",
        coverage=f"{POSTERIORS}/test/coverage.csv",
        diagnostics=f"{POSTERIORS}/test/diagnostics.csv",
        library=library("figures.recovery"),
    output:
        png=report(
            f"{R}/figures/recovery.png", caption="../report/recovery.rst", category="Test set"
        ),
        csv=f"{R}/figures/recovery.csv",
    params:
        emulator=EMULATOR,
    log:
        f"{LOGS}/figures/recovery.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_recovery.py"


rule plot_bullseye_posterior:
    input:
        posterior=f"{POSTERIORS}/subjects/{{subject}}.nc",
        diagnostics=f"{POSTERIORS}/subjects/{{subject}}.csv",
        truth=lambda wildcards: TRUTHS.get(wildcards.subject, []),
        library=library("figures.bullseye_posterior"),
    output:
        png=report(
            f"{R}/figures/{{subject}}/bullseye_posterior.png",
            caption="../report/bullseye_posterior.rst",
            category="Subjects",
            subcategory="{subject}",
        ),
        csv=f"{R}/figures/{{subject}}/bullseye_posterior.csv",
    params:
        source=lambda wildcards: SUBJECT_SOURCES[wildcards.subject],
    log:
        f"{LOGS}/figures/{{subject}}/bullseye_posterior.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_bullseye_posterior.py"


rule plot_posterior_predictive:
    input:
        posterior=f"{POSTERIORS}/subjects/{{subject}}.nc",
        diagnostics=f"{POSTERIORS}/subjects/{{subject}}.csv",
        library=library("figures.posterior_predictive"),
    output:
        png=report(
            f"{R}/figures/{{subject}}/posterior_predictive.png",
            caption="../report/posterior_predictive.rst",
            category="Subjects",
            subcategory="{subject}",
        ),
        csv=f"{R}/figures/{{subject}}/posterior_predictive.csv",
    params:
        source=lambda wildcards: SUBJECT_SOURCES[wildcards.subject],
    log:
        f"{LOGS}/figures/{{subject}}/posterior_predictive.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_posterior_predictive.py"


rule plot_traces:
    input:
        posterior=f"{POSTERIORS}/subjects/{{subject}}.nc",
        diagnostics=f"{POSTERIORS}/subjects/{{subject}}.csv",
        truth=lambda wildcards: TRUTHS.get(wildcards.subject, []),
        library=library("figures.traces"),
    output:
        png=report(
            f"{R}/figures/{{subject}}/traces.png",
            caption="../report/traces.rst",
            category="Subjects",
            subcategory="{subject}",
        ),
        csv=f"{R}/figures/{{subject}}/traces.csv",
    params:
        source=lambda wildcards: SUBJECT_SOURCES[wildcards.subject],
    log:
        f"{LOGS}/figures/{{subject}}/traces.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_traces.py"


rule make_table_diagnostics:
    input:
        test=f"{POSTERIORS}/test/diagnostics.csv",
        subjects=expand(f"{POSTERIORS}/subjects/{{subject}}.csv", subject=SUBJECTS),
        library=library("tables"),
    output:
        csv=report(
            f"{R}/tables/diagnostics.csv",
            caption="../report/table_diagnostics.rst",
            category="Test set",
        ),
        tex=f"{R}/tables/diagnostics.tex",
    log:
        f"{LOGS}/tables/diagnostics.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_diagnostics.py"


rule make_table_recovery:
    input:
        recovery=f"{POSTERIORS}/test/recovery.csv",
        coverage=f"{POSTERIORS}/test/coverage.csv",
        diagnostics=f"{POSTERIORS}/test/diagnostics.csv",
        library=library("tables"),
    output:
        csv=report(
            f"{R}/tables/recovery.csv",
            caption="../report/table_recovery.rst",
            category="Test set",
        ),
        tex=f"{R}/tables/recovery.tex",
    log:
        f"{LOGS}/tables/recovery.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_recovery.py"


rule make_table_subjects:
    input:
        posteriors=expand(f"{POSTERIORS}/subjects/{{subject}}.nc", subject=SUBJECTS),
        diagnostics=expand(f"{POSTERIORS}/subjects/{{subject}}.csv", subject=SUBJECTS),
        library=library("tables"),
    output:
        csv=report(
            f"{R}/tables/subjects.csv",
            caption="../report/table_subjects.rst",
            category="Subjects",
        ),
        tex=f"{R}/tables/subjects.tex",
    params:
        sources=[SUBJECT_SOURCES[subject] for subject in SUBJECTS],
    log:
        f"{LOGS}/tables/subjects.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_subjects.py"
