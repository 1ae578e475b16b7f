"""Figures and tables of the stiffening scenarios, without and with measurement noise."""

SCENARIO_LABELS = {
    name: f"{scenario['kind']}, μ = {scenario['mu']:g}"
    for name, scenario in SCENARIOS.items()
}
BULLSEYES = {
    "local": (LOCAL, "stiffened", "Local stiffening"),
    "global": (GLOBAL, "stiffened", "Global stiffening"),
    "baseline": (LOCAL, "baseline", "Local stiffening"),
}
NOISE_TITLES = {"": "", "-noisy": ", with measurement noise"}


rule plot_bullseye_map:
    input:
        recovery=lambda wildcards: expand(
            f"{POSTERIORS}/{{name}}{wildcards.noise}/recovery.csv", name=BULLSEYES[wildcards.which][0]
        ),
        library=library("figures.bullseye_map"),
    output:
        png=report(
            f"{R}/figures/bullseye_{{which}}{{noise}}.png",
            caption="../report/bullseye_map.rst",
            category="Scenarios",
        ),
        csv=f"{R}/figures/bullseye_{{which}}{{noise}}.csv",
    params:
        labels=lambda wildcards: [SCENARIO_LABELS[n] for n in BULLSEYES[wildcards.which][0]],
        zones=lambda wildcards: BULLSEYES[wildcards.which][1],
        title=lambda wildcards: BULLSEYES[wildcards.which][2] + NOISE_TITLES[wildcards.noise],
    wildcard_constraints:
        which=any_of(BULLSEYES),
        noise=any_of(NOISE_TITLES),
    log:
        f"{LOGS}/figures/bullseye_{{which}}{{noise}}.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_bullseye_map.py"


rule plot_map_errors:
    input:
        recovery=expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=SCENARIOS),
        noisy=expand(f"{POSTERIORS}/{{name}}-noisy/recovery.csv", name=SCENARIOS),
        library=library("figures.map_errors"),
    output:
        png=report(
            f"{R}/figures/map_errors.png",
            caption="../report/map_errors.rst",
            category="Scenarios",
        ),
        csv=f"{R}/figures/map_errors.csv",
    params:
        labels=list(SCENARIO_LABELS.values()),
    log:
        f"{LOGS}/figures/map_errors.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_map_errors.py"


rule plot_hpd_widths:
    input:
        recovery=expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=SCENARIOS),
        noisy=expand(f"{POSTERIORS}/{{name}}-noisy/recovery.csv", name=SCENARIOS),
        library=library("figures.hpd_widths"),
    output:
        png=report(
            f"{R}/figures/hpd_widths.png",
            caption="../report/hpd_widths.rst",
            category="Scenarios",
        ),
        csv=f"{R}/figures/hpd_widths.csv",
    params:
        labels=list(SCENARIO_LABELS.values()),
        bounds=BOUNDS,
    log:
        f"{LOGS}/figures/hpd_widths.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_hpd_widths.py"


rule plot_zone_correlations:
    input:
        correlations=expand(f"{POSTERIORS}/{{name}}{{{{noise}}}}/zone_correlations.csv", name=SCENARIOS),
        recovery=expand(f"{POSTERIORS}/{{name}}{{{{noise}}}}/recovery.csv", name=SCENARIOS),
        library=library("figures.correlations"),
    output:
        png=report(
            f"{R}/figures/zone_correlations{{noise}}.png",
            caption="../report/zone_correlations.rst",
            category="Scenarios",
        ),
        csv=f"{R}/figures/zone_correlations{{noise}}.csv",
    params:
        labels=list(SCENARIO_LABELS.values()),
        title=lambda wildcards: (
            f"Posterior correlations of zones{NOISE_TITLES[wildcards.noise]}: mean ± standard error"
        ),
    wildcard_constraints:
        noise=any_of(NOISE_TITLES),
    log:
        f"{LOGS}/figures/zone_correlations{{noise}}.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_zone_correlations.py"


rule plot_correlations:
    input:
        correlations=f"{POSTERIORS}/{{name}}{{noise}}/correlations.csv",
        recovery=f"{POSTERIORS}/{{name}}{{noise}}/recovery.csv",
        library=library("figures.correlations"),
    output:
        png=report(
            f"{R}/figures/correlations/{{name}}{{noise}}.png",
            caption="../report/correlations.rst",
            category="Scenarios",
        ),
        csv=f"{R}/figures/correlations/{{name}}{{noise}}.csv",
    params:
        label=lambda wildcards: SCENARIO_LABELS[wildcards.name] + NOISE_TITLES[wildcards.noise],
    wildcard_constraints:
        name=any_of(SCENARIOS),
        noise=any_of(NOISE_TITLES),
    log:
        f"{LOGS}/figures/correlations/{{name}}{{noise}}.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_correlations.py"


rule plot_roc:
    input:
        curves=expand(f"{POSTERIORS}/{{name}}/roc.csv", name=[*SCENARIOS, *NOISY]),
        areas=expand(f"{POSTERIORS}/{{name}}/auc.csv", name=[*SCENARIOS, *NOISY]),
        recovery=expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=[*SCENARIOS, *NOISY]),
        library=library("figures.roc"),
    output:
        png=report(
            f"{R}/figures/roc.png",
            caption="../report/roc.rst",
            category="Scenarios",
        ),
        csv=f"{R}/figures/roc.csv",
    params:
        labels=list(SCENARIO_LABELS.values()),
    log:
        f"{LOGS}/figures/roc.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_roc.py"


rule make_table_scenarios:
    input:
        coverage=expand(f"{POSTERIORS}/{{name}}/coverage.csv", name=SETS),
        areas=expand(f"{POSTERIORS}/{{name}}/auc.csv", name=[*SCENARIOS, *NOISY]),
        recovery=expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=SETS),
        library=library("tables.posteriors", "tables.writing"),
    output:
        csv=report(
            f"{R}/tables/scenarios.csv",
            caption="../report/table_scenarios.rst",
            category="Scenarios",
        ),
        tex=f"{R}/tables/scenarios.tex",
    log:
        f"{LOGS}/tables/scenarios.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_scenarios.py"
