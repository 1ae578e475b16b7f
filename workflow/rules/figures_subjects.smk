"""Figures and tables of subjects."""


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


rule make_table_subjects:
    input:
        posteriors=expand(f"{POSTERIORS}/subjects/{{subject}}.nc", subject=SUBJECTS),
        diagnostics=expand(f"{POSTERIORS}/subjects/{{subject}}.csv", subject=SUBJECTS),
        library=library("tables.subjects", "tables.writing"),
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


rule plot_noise_prior:
    input:
        noise_prior=f"{POSTERIORS}/subjects/{{subject}}_noise_prior.csv",
        library=library("figures.noise_prior"),
    output:
        png=report(
            f"{R}/figures/{{subject}}/noise_prior.png",
            caption="../report/noise_prior.rst",
            category="Subjects",
            subcategory="{subject}",
        ),
        csv=f"{R}/figures/{{subject}}/noise_prior.csv",
    params:
        source=lambda wildcards: SUBJECT_SOURCES[wildcards.subject],
    log:
        f"{LOGS}/figures/{{subject}}/noise_prior.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_noise_prior.py"


rule make_table_noise_prior:
    input:
        noise_prior=f"{POSTERIORS}/subjects/{{subject}}_noise_prior.csv",
        library=library("tables.subjects", "tables.writing"),
    output:
        csv=report(
            f"{R}/tables/{{subject}}/noise_prior.csv",
            caption="../report/table_noise_prior.rst",
            category="Subjects",
            subcategory="{subject}",
        ),
        tex=f"{R}/tables/{{subject}}/noise_prior.tex",
    log:
        f"{LOGS}/tables/{{subject}}/noise_prior.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_noise_prior.py"


rule make_table_convergence:
    input:
        posterior=f"{POSTERIORS}/subjects/{{subject}}.nc",
        diagnostics=f"{POSTERIORS}/subjects/{{subject}}.csv",
        library=library("tables.subjects", "tables.writing"),
    output:
        csv=report(
            f"{R}/tables/{{subject}}/convergence.csv",
            caption="../report/table_convergence.rst",
            category="Subjects",
            subcategory="{subject}",
        ),
        tex=f"{R}/tables/{{subject}}/convergence.tex",
    log:
        f"{LOGS}/tables/{{subject}}/convergence.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_convergence.py"
