"""Figures and tables of the posteriors of the test set: shortlisted emulators, and the chosen one."""

TRACED = {"emulator_traces": list(PARAMETERS[:2]), "emulator_traces_all": list(PARAMETERS)}


rule plot_recovery:
    input:
        recovery=f"{POSTERIORS}/test/recovery.csv",
        coverage=f"{POSTERIORS}/test/coverage.csv",
        diagnostics=f"{POSTERIORS}/test/diagnostics.csv",
        choice=f"{R}/posteriors/final.json",
        library=library("figures.recovery"),
    output:
        png=report(
            f"{R}/figures/recovery.png", caption="../report/recovery.rst", category="Test set"
        ),
        csv=f"{R}/figures/recovery.csv",
    log:
        f"{LOGS}/figures/recovery.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_recovery.py"


rule make_table_recovery:
    input:
        coverage=f"{POSTERIORS}/test/coverage.csv",
        library=library("tables.posteriors", "tables.writing"),
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


rule plot_uncertainty:
    input:
        coverage=lambda wildcards: of_shortlist("coverage.csv"),
        errors=lambda wildcards: of_shortlist("map_mse.csv"),
        library=library("figures.uncertainty"),
    output:
        png=report(
            f"{R}/figures/uncertainty.png",
            caption="../report/uncertainty.rst",
            category="Test set",
        ),
        csv=f"{R}/figures/uncertainty.csv",
    log:
        f"{LOGS}/figures/uncertainty.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_uncertainty.py"


rule plot_emulator_traces:
    input:
        errors=f"{POSTERIORS}/test/map_mse.csv",
        posteriors=lambda wildcards: of_shortlist(
            *(f"{batch}.nc" for batch in posterior_batches("test"))
        ),
        diagnostics=lambda wildcards: of_shortlist("diagnostics.csv"),
        library=library("figures.emulator_traces"),
    output:
        png=report(
            f"{R}/figures/{{which}}.png",
            caption="../report/emulator_traces.rst",
            category="Test set",
        ),
        csv=f"{R}/figures/{{which}}.csv",
    params:
        parameters=lambda wildcards: TRACED[wildcards.which],
    wildcard_constraints:
        which=any_of(TRACED),
    log:
        f"{LOGS}/figures/{{which}}.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_emulator_traces.py"


rule plot_sbc:
    input:
        ranks=f"{POSTERIORS}/sbc.csv",
        tests=f"{POSTERIORS}/sbc_test.csv",
        choice=f"{R}/posteriors/final.json",
        library=library("figures.sbc"),
    output:
        png=report(
            f"{R}/figures/sbc.png",
            caption="../report/sbc.rst",
            category="Test set",
        ),
        csv=f"{R}/figures/sbc.csv",
    log:
        f"{LOGS}/figures/sbc.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_sbc.py"


rule make_table_variance_ratios:
    input:
        coverage=lambda wildcards: of_shortlist("coverage.csv"),
        library=library("tables.posteriors", "tables.writing"),
    output:
        csv=report(
            f"{R}/tables/variance_ratios.csv",
            caption="../report/table_variance_ratios.rst",
            category="Test set",
        ),
        tex=f"{R}/tables/variance_ratios.tex",
    log:
        f"{LOGS}/tables/variance_ratios.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_variance_ratios.py"


rule make_table_choice:
    input:
        choice=f"{R}/posteriors/final.json",
        library=library("tables.posteriors", "tables.writing"),
    output:
        csv=report(
            f"{R}/tables/choice.csv",
            caption="../report/table_choice.rst",
            category="Test set",
        ),
        tex=f"{R}/tables/choice.tex",
    log:
        f"{LOGS}/tables/choice.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_choice.py"


rule make_table_diagnostics:
    input:
        shortlist=lambda wildcards: of_shortlist("diagnostics.csv"),
        scenarios=expand(f"{POSTERIORS}/{{name}}/diagnostics.csv", name=[*SCENARIOS, *NOISY]),
        subjects=expand(f"{POSTERIORS}/subjects/{{subject}}.csv", subject=SUBJECTS),
        library=library("tables.posteriors", "tables.writing"),
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


rule plot_resimulation:
    input:
        resimulated=f"{POSTERIORS}/resimulated.csv",
        library=library("figures.trust"),
    output:
        png=report(
            f"{R}/figures/resimulation.png",
            caption="../report/resimulation.rst",
            category="Test set",
        ),
        csv=f"{R}/figures/resimulation.csv",
    log:
        f"{LOGS}/figures/resimulation.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_resimulation.py"


rule plot_sampler_agreement:
    input:
        agreement=f"{POSTERIORS}/sampler_agreement.csv",
        library=library("figures.trust"),
    output:
        png=report(
            f"{R}/figures/sampler_agreement.png",
            caption="../report/sampler_agreement.rst",
            category="Test set",
        ),
        csv=f"{R}/figures/sampler_agreement.csv",
    log:
        f"{LOGS}/figures/sampler_agreement.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_sampler_agreement.py"
