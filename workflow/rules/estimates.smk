"""Point estimates of the test set by every emulator, checked, ranked, and the shortlist."""

ESTIMATES = f"{R}/estimates"
RANKED = config["emulators"]["names"]


rule estimate_parameters:
    input:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        test=f"{R}/screening/test.parquet",
        library=library("estimates.estimate"),
    output:
        f"{ESTIMATES}/{{emulator}}/test.parquet",
    params:
        map=config["map"],
        estimates={key: config["estimates"][key] for key in ("adam_steps", "hops")},
        seed=config["seed"],
    log:
        f"{LOGS}/estimates/{{emulator}}/estimate_parameters.log",
    benchmark:
        f"{R}/benchmarks/estimates/{{emulator}}.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/estimate_parameters.py"


rule measure_cost:
    input:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        test=f"{R}/screening/test.parquet",
        library=library("estimates.estimate"),
    output:
        f"{ESTIMATES}/{{emulator}}/cost.json",
    log:
        f"{LOGS}/estimates/{{emulator}}/measure_cost.log",
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/measure_cost.py"


if FROM_TABLES:

    rule fit_stand_in:
        """In place of the simulator, which is not there."""
        input:
            train=f"{R}/screening/train.parquet",
            test=f"{R}/screening/test.parquet",
            library=library("estimates.stand_in"),
        output:
            f"{ESTIMATES}/stand_in.pt",
        params:
            bounds=BOUNDS,
            seed=config["seed"],
        log:
            f"{LOGS}/estimates/fit_stand_in.log",
        threads: 1
        conda:
            "../../envs/statistics.yaml"
        script:
            "../scripts/fit_stand_in.py"

    rule predict_estimates:
        input:
            stand_in=f"{ESTIMATES}/stand_in.pt",
            estimates=f"{ESTIMATES}/{{emulator}}/test.parquet",
            library=library("estimates.stand_in"),
        output:
            f"{ESTIMATES}/{{emulator}}/checked.parquet",
        params:
            cases=config["estimates"]["checked_cases"],
        log:
            f"{LOGS}/estimates/{{emulator}}/predict_estimates.log",
        threads: 1
        conda:
            "../../envs/statistics.yaml"
        script:
            "../scripts/predict_estimates.py"

else:

    rule simulate_estimates:
        input:
            mesh=f"{R}/geometry/mesh.vtu",
            predictor=f"{R}/mechanics/predictor.npz",
            estimates=f"{ESTIMATES}/{{emulator}}/test.parquet",
            library=library("estimates.check"),
        output:
            f"{ESTIMATES}/{{emulator}}/checked.parquet",
        params:
            physics=PHYSICS,
            cases=config["estimates"]["checked_cases"],
        log:
            f"{LOGS}/estimates/{{emulator}}/simulate_estimates.log",
        benchmark:
            f"{R}/benchmarks/estimates/{{emulator}}_simulated.tsv"
        threads: 1
        conda:
            "../../envs/mechanics.yaml"
        script:
            "../scripts/simulate_estimates.py"


checkpoint rank_emulators:
    input:
        estimates=expand(f"{ESTIMATES}/{{emulator}}/test.parquet", emulator=RANKED),
        checked=expand(f"{ESTIMATES}/{{emulator}}/checked.parquet", emulator=RANKED),
        costs=expand(f"{ESTIMATES}/{{emulator}}/cost.json", emulator=RANKED),
        fits=expand(f"{R}/emulators/{{emulator}}/fit.json", emulator=RANKED),
        predictions=expand(
            f"{R}/emulators/{{emulator}}/test_predictions.parquet", emulator=RANKED
        ),
        train=f"{R}/screening/train.parquet",
        test=f"{R}/screening/test.parquet",
        paper="resources/paper_numbers.csv",
        library=library("estimates.ranking"),
    output:
        ranking=f"{ESTIMATES}/ranking.csv",
        pairs=f"{ESTIMATES}/pairs.csv",
        shortlist=f"{ESTIMATES}/shortlist.json",
    params:
        names=RANKED,
        size=config["emulators"]["shortlist"]["size"],
        estimator=config["emulators"]["shortlist"]["estimator"],
    log:
        f"{LOGS}/estimates/rank_emulators.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/rank_emulators.py"


rule plot_per_sample_mse:
    input:
        estimates=expand(f"{ESTIMATES}/{{emulator}}/test.parquet", emulator=RANKED),
        shortlist=f"{ESTIMATES}/shortlist.json",
        library=library("figures.per_sample_mse"),
    output:
        png=report(
            f"{R}/figures/per_sample_mse.png",
            caption="../report/per_sample_mse.rst",
            category="Emulator",
        ),
        csv=f"{R}/figures/per_sample_mse.csv",
    params:
        names=RANKED,
    log:
        f"{LOGS}/figures/per_sample_mse.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_per_sample_mse.py"


rule make_table_architectures:
    input:
        fits=expand(f"{R}/emulators/{{emulator}}/fit.json", emulator=RANKED),
        library=library("tables.emulators", "tables.writing"),
    output:
        csv=report(
            f"{R}/tables/architectures.csv",
            caption="../report/table_architectures.rst",
            category="Emulator",
        ),
        tex=f"{R}/tables/architectures.tex",
    log:
        f"{LOGS}/tables/architectures.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_architectures.py"


rule make_table_ranking:
    input:
        ranking=f"{ESTIMATES}/ranking.csv",
        library=library("tables.emulators", "tables.writing"),
    output:
        csv=report(
            f"{R}/tables/ranking.csv",
            caption="../report/table_ranking.rst",
            category="Emulator",
        ),
        tex=f"{R}/tables/ranking.tex",
    log:
        f"{LOGS}/tables/ranking.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_ranking.py"


rule make_table_pairs:
    input:
        pairs=f"{ESTIMATES}/pairs.csv",
        library=library("tables.emulators", "tables.writing"),
    output:
        csv=report(
            f"{R}/tables/pairs.csv",
            caption="../report/table_pairs.rst",
            category="Emulator",
        ),
        tex=f"{R}/tables/pairs.tex",
    log:
        f"{LOGS}/tables/pairs.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_pairs.py"


rule compare_transforms:
    input:
        estimates=expand(f"{ESTIMATES}/{{emulator}}/test.parquet", emulator=EMULATORS),
        predictions=expand(
            f"{R}/emulators/{{emulator}}/test_predictions.parquet", emulator=EMULATORS
        ),
        train=f"{R}/screening/train.parquet",
        paper="resources/paper_numbers.csv",
        library=library("estimates.transforms"),
    output:
        f"{ESTIMATES}/transforms.csv",
    params:
        transforms=TRANSFORMS,
    log:
        f"{LOGS}/estimates/compare_transforms.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/compare_transforms.py"


rule make_table_transforms:
    input:
        transforms=f"{ESTIMATES}/transforms.csv",
        library=library("tables.emulators", "tables.writing"),
    output:
        csv=report(
            f"{R}/tables/transforms.csv",
            caption="../report/table_transforms.rst",
            category="Emulator",
        ),
        tex=f"{R}/tables/transforms.tex",
    log:
        f"{LOGS}/tables/transforms.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_transforms.py"


rule measure_efficiency:
    input:
        train=f"{R}/screening/train.parquet",
        test=f"{R}/screening/test.parquet",
        library=library("estimates.efficiency"),
    output:
        f"{R}/efficiency/{{emulator}}-{{transform}}.csv",
    params:
        settings=lambda wildcards: config["emulators"][wildcards.emulator],
        sizes=config["efficiency"]["sizes"],
        most_with_sensitivities=config["efficiency"]["most_with_sensitivities"],
        bounds=BOUNDS,
        map=config["map"],
        seed=config["seed"],
    wildcard_constraints:
        emulator="exact_gp|gradient_gp",
        transform="log|identity",
    log:
        f"{LOGS}/efficiency/{{emulator}}-{{transform}}.log",
    benchmark:
        f"{R}/benchmarks/efficiency/{{emulator}}-{{transform}}.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/measure_efficiency.py"


rule plot_sample_efficiency:
    input:
        curves=expand(f"{R}/efficiency/{{curve}}.csv", curve=EFFICIENCY_CURVES),
        library=library("figures.sample_efficiency"),
    output:
        png=report(
            f"{R}/figures/sample_efficiency.png",
            caption="../report/sample_efficiency.rst",
            category="Emulator",
        ),
        csv=f"{R}/figures/sample_efficiency.csv",
    log:
        f"{LOGS}/figures/sample_efficiency.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/plot_sample_efficiency.py"


rule make_table_sample_efficiency:
    input:
        curves=expand(f"{R}/efficiency/{{curve}}.csv", curve=EFFICIENCY_CURVES),
        library=library("tables.emulators", "tables.writing"),
    output:
        csv=report(
            f"{R}/tables/sample_efficiency.csv",
            caption="../report/table_sample_efficiency.rst",
            category="Emulator",
        ),
        tex=f"{R}/tables/sample_efficiency.tex",
    log:
        f"{LOGS}/tables/sample_efficiency.log",
    conda:
        "../../envs/figures.yaml"
    script:
        "../scripts/make_table_sample_efficiency.py"


rule sample_efficiency:
    """How many simulations a Gaussian process needs, with and without their sensitivities."""
    input:
        expand(f"{R}/figures/sample_efficiency.{{ext}}", ext=["png", "csv"]),
        expand(f"{R}/tables/sample_efficiency.{{ext}}", ext=["csv", "tex"]),


rule compare_emulators:
    """Everything up to the shortlist, without posteriors."""
    input:
        f"{ESTIMATES}/shortlist.json",
        expand(f"{R}/figures/{{name}}.{{ext}}", name=COMPARISON_FIGURES, ext=["png", "csv"]),
        expand(f"{R}/tables/{{name}}.{{ext}}", name=COMPARISON_TABLES, ext=["csv", "tex"]),
