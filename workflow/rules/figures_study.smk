"""Figures of the heart, its simulations and the emulator."""


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
        choice=f"{R}/posteriors/final.json",
        library=library("figures.parity"),
    output:
        png=report(
            f"{R}/figures/parity.png", caption="../report/parity.rst", category="Emulator"
        ),
        csv=f"{R}/figures/parity.csv",
    log:
        f"{LOGS}/figures/parity.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_parity.py"


rule plot_strain_field:
    input:
        mesh=f"{R}/mechanics/strains.vtu",
        strains=f"{R}/mechanics/strains.parquet",
        library=library("figures.strain_field"),
    output:
        png=report(
            f"{R}/figures/strain_field.png",
            caption="../report/strain_field.rst",
            category="Geometry",
        ),
        csv=f"{R}/figures/strain_field.csv",
    log:
        f"{LOGS}/figures/strain_field.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_strain_field.py"
