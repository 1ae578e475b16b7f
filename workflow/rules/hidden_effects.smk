"""The benchmark of hidden effects: hearts whose truth is known, criticised blind, and the score."""

HIDDEN = f"{R}/hidden_effects"


if not FROM_TABLES:
    BENCHMARK = config["criticism"]["benchmark"]
    HEART_BATCHES = batches(sum(BENCHMARK["hearts"].values()), BENCHMARK["subjects_per_batch"])
    # Hearts share none of the study's errors of discretisation, where it can make a finer mesh.
    HEARTS_ON = "finer/" if meshes_anew(config) else ""
    BENCHMARK_STEP = {
        "physics": INPUTS,
        "settings": CRITICISM | {"bootstrap": BENCHMARK["bootstrap"]},
        "seed": config["seed"],
    }

    rule hidden_effects:
        """What is found of effects injected at random."""
        input:
            f"{HIDDEN}/summary.json",
            f"{HIDDEN}/hidden_effects.png",

    rule inject_hearts:
        """Simulates and measures hearts; writes their truth and reads none."""
        input:
            mesh=LAYOUT.heart(HEARTS_ON).mesh,
            predictor=LAYOUT.inputs_predictor(HEARTS_ON) if FINER or not HEARTS_ON else [],
        output:
            subjects=f"{HIDDEN}/subjects/batch-{{batch}}.parquet",
            truth=f"{R}/truth/hidden_effects/batch-{{batch}}.parquet",
        log:
            f"{LOGS}/hidden_effects/inject-{{batch}}.log",
        benchmark:
            f"{R}/benchmarks/hidden_effects/inject-{{batch}}.tsv"
        threads: 1
        resources:
            **needs(minutes=120),
        params:
            call="hidden_effects.injection:inject_batch",
            physics=INPUTS,
            hearts=BENCHMARK["hearts"],
            noise=BENCHMARK["noise"],
            batch_size=BENCHMARK["subjects_per_batch"],
        script:
            "../scripts/call.py"

    rule criticise_hearts:
        """Blind: reads the measured hearts alone."""
        input:
            subjects=f"{HIDDEN}/subjects/batch-{{batch}}.parquet",
            emulator_file=own_emulator_of_inputs,
            mesh=LAYOUT.heart().mesh,
            predictor=LAYOUT.inputs_predictor(),
        output:
            findings=f"{HIDDEN}/findings/batch-{{batch}}.json",
        log:
            f"{LOGS}/hidden_effects/criticise-{{batch}}.log",
        benchmark:
            f"{R}/benchmarks/hidden_effects/criticise-{{batch}}.tsv"
        threads: 1
        resources:
            **needs(mem_mb=3000, minutes=240),
        params:
            **BENCHMARK_STEP,
            call="hidden_effects.blind:criticise_batch",
        script:
            "../scripts/call.py"

    rule sample_true_models:
        """What could have been found, had the causes been known."""
        input:
            subjects=f"{HIDDEN}/subjects/batch-{{batch}}.parquet",
            truth=f"{R}/truth/hidden_effects/batch-{{batch}}.parquet",
            emulator_file=own_emulator_of_inputs,
        output:
            models=f"{HIDDEN}/true_models/batch-{{batch}}.parquet",
        log:
            f"{LOGS}/hidden_effects/true_models-{{batch}}.log",
        benchmark:
            f"{R}/benchmarks/hidden_effects/true_models-{{batch}}.tsv"
        threads: 1
        resources:
            **needs(mem_mb=3000, minutes=120),
        params:
            **BENCHMARK_STEP,
            call="hidden_effects.score:sample_true_models",
        script:
            "../scripts/call.py"

    rule score_benchmark:
        """After all verdicts are in."""
        input:
            findings=expand(f"{HIDDEN}/findings/batch-{{batch}}.json", batch=HEART_BATCHES),
            truth=expand(f"{R}/truth/hidden_effects/batch-{{batch}}.parquet", batch=HEART_BATCHES),
            models=expand(f"{HIDDEN}/true_models/batch-{{batch}}.parquet", batch=HEART_BATCHES),
        output:
            cases=f"{HIDDEN}/cases.csv",
            stiffness=f"{HIDDEN}/stiffness.csv",
            confusion=f"{HIDDEN}/confusion.csv",
            reliability=f"{HIDDEN}/reliability.csv",
            summary=f"{HIDDEN}/summary.json",
        log:
            f"{LOGS}/hidden_effects/score_benchmark.log",
        localrule: True
        params:
            call="hidden_effects.score:score_benchmark",
        script:
            "../scripts/call.py"

    rule plot_hidden_effects:
        input:
            cases_file=f"{HIDDEN}/cases.csv",
            stiffness_file=f"{HIDDEN}/stiffness.csv",
            reliability_file=f"{HIDDEN}/reliability.csv",
        output:
            png=report(
                f"{HIDDEN}/hidden_effects.png",
                caption="../report/hidden_effects.rst",
                category="Hidden effects",
            ),
            csv=f"{HIDDEN}/hidden_effects.csv",
        log:
            f"{LOGS}/hidden_effects/plot_hidden_effects.log",
        localrule: True
        params:
            call="plots.hidden_effects:draw",
        script:
            "../scripts/call.py"
