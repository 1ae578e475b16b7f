"""All inputs that are not fixed (`inputs`): a design over them, simulations with the derivatives
about each, and one emulator."""

ALL_INPUTS = config["all_inputs"]
OVER_INPUTS = f"{R}/all_inputs"
INPUTS_BATCHES = {
    name: batches(ALL_INPUTS[size], config["simulations"]["batch_size"])
    for name, size in {"train": "simulations", "test": "test"}.items()
}
INPUTS_ANCHORS = min(ALL_INPUTS["anchors"], ALL_INPUTS["simulations"])
INPUTS_ANCHOR_BATCHES = batches(INPUTS_ANCHORS, -(-INPUTS_ANCHORS // 2))

if config["inputs"]:
    # The catalogue takes a while to import, and most studies do without.
    from regional_lv.emulators import OF_INPUTS
    from regional_lv.inputs.space import Inputs, sections_of

    INPUTS = sections_of(config)
    SIMULATED = Inputs.from_config(INPUTS).simulated
    COORDINATES = SIMULATED.coordinates.spec()
    SUSPECTED = SIMULATED.subset(SIMULATED.of_role("suspected"))

    rule design_inputs:
        output:
            train=f"{OVER_INPUTS}/design/train.parquet",
            test=f"{OVER_INPUTS}/design/test.parquet",
        log:
            f"{LOGS}/all_inputs/design_inputs.log",
        localrule: True
        params:
            call="simulation.design:write_design",
            physics=INPUTS,
            sizes={"train": ALL_INPUTS["simulations"], "test": ALL_INPUTS["test"]},
            seed=config["seed"],
        script:
            "../scripts/call.py"

    use rule solve_baseline as solve_inputs_baseline with:
        input:
            mesh=f"{R}/geometry/mesh.vtu",
        output:
            start=f"{OVER_INPUTS}/baseline.npz",
            summary=f"{OVER_INPUTS}/baseline.json",
        log:
            f"{LOGS}/all_inputs/solve_baseline.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/solve_baseline.tsv"
        params:
            call="simulations:solve_baseline",
            physics=INPUTS,

    use rule solve_anchors as solve_inputs_anchors with:
        input:
            mesh=f"{R}/geometry/mesh.vtu",
            start=f"{OVER_INPUTS}/baseline.npz",
            design=f"{OVER_INPUTS}/design/train.parquet",
        output:
            fields=f"{OVER_INPUTS}/anchors/batch-{{batch}}.npz",
            simulations=f"{OVER_INPUTS}/anchors/batch-{{batch}}.parquet",
        log:
            f"{LOGS}/all_inputs/solve_anchors-{{batch}}.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/anchors/batch-{{batch}}.tsv"
        params:
            call="simulations:solve_anchors",
            physics=INPUTS,
            anchors=INPUTS_ANCHORS,
            batches=len(INPUTS_ANCHOR_BATCHES),

    use rule fit_predictor as fit_inputs_predictor with:
        input:
            anchors=expand(f"{OVER_INPUTS}/anchors/{{batch}}.npz", batch=INPUTS_ANCHOR_BATCHES),
        output:
            predictor=f"{OVER_INPUTS}/predictor.npz",
        log:
            f"{LOGS}/all_inputs/fit_predictor.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/fit_predictor.tsv"
        params:
            call="mechanics.predictor:fit_predictor",
            physics=INPUTS,

    use rule simulate_batch as simulate_inputs with:
        input:
            mesh=f"{R}/geometry/mesh.vtu",
            predictor=f"{OVER_INPUTS}/predictor.npz",
            design=f"{OVER_INPUTS}/design/{{set}}.parquet",
            anchors=lambda wildcards: (
                expand(f"{OVER_INPUTS}/anchors/{{batch}}.parquet", batch=INPUTS_ANCHOR_BATCHES)
                if wildcards.set == "train"
                else []
            ),
        output:
            simulations=f"{OVER_INPUTS}/simulations/{{set}}/batch-{{batch}}.parquet",
        log:
            f"{LOGS}/all_inputs/simulations/{{set}}/batch-{{batch}}.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/simulations/{{set}}/batch-{{batch}}.tsv"
        wildcard_constraints:
            set=any_of(INPUTS_BATCHES),
        params:
            call="simulations:simulate_batch",
            physics=INPUTS,
            batch_size=config["simulations"]["batch_size"],

    rule screen_inputs:
        input:
            batches=lambda wildcards: expand(
                f"{OVER_INPUTS}/simulations/{wildcards.set}/{{batch}}.parquet",
                batch=INPUTS_BATCHES[wildcards.set],
            ),
        output:
            kept=f"{OVER_INPUTS}/{{set}}.parquet",
            excluded=f"{OVER_INPUTS}/{{set}}_excluded.csv",
            summary=f"{OVER_INPUTS}/{{set}}_summary.csv",
        log:
            f"{LOGS}/all_inputs/screen_{{set}}.log",
        wildcard_constraints:
            set=any_of(INPUTS_BATCHES),
        localrule: True
        params:
            call="screening:screen_simulations",
            parameters=COORDINATES,
            channels=OUTPUTS,
            steepest=ALL_INPUTS["steepest"],
        script:
            "../scripts/call.py"

    use rule train_emulator as train_on_inputs with:
        input:
            train=f"{OVER_INPUTS}/train.parquet",
        output:
            emulator_file=f"{OVER_INPUTS}/emulator.pt",
            report=f"{OVER_INPUTS}/fit.json",
        log:
            f"{LOGS}/all_inputs/train.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/train.tsv"
        params:
            call="emulators.training:train_emulator",
            name=OF_INPUTS,
            settings=config["emulators"][OF_INPUTS],
            parameters=COORDINATES,
            channels=OUTPUTS,
            seed=config["seed"],

    rule judge_inputs_emulator:
        """By how many of the suspected inputs are on."""
        input:
            emulator_file=f"{OVER_INPUTS}/emulator.pt",
            test=f"{OVER_INPUTS}/test.parquet",
        output:
            errors=f"{OVER_INPUTS}/errors.csv",
        log:
            f"{LOGS}/all_inputs/errors.log",
        threads: 1
        params:
            call="emulators.errors_by_causes:judge",
            nominal=dict(zip(SUSPECTED.names, SUSPECTED.nominal.tolist())),
        script:
            "../scripts/call.py"

    rule average_models:
        """The posterior of a subject over all inputs, averaged over sets of suspected ones."""
        input:
            emulator_file=f"{OVER_INPUTS}/emulator.pt",
            measured=f"{R}/measured/{{subject}}.csv",
        output:
            posterior=f"{OVER_INPUTS}/posteriors/{{subject}}.nc",
            table=f"{OVER_INPUTS}/posteriors/{{subject}}.csv",
        log:
            f"{LOGS}/all_inputs/posteriors/{{subject}}.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/posteriors/{{subject}}.tsv"
        wildcard_constraints:
            subject=any_of(SUBJECTS),
        threads: 1
        params:
            call="inference.subject_average:average_subject",
            physics=INPUTS,
            noise_prior_scale=config["clinical"]["noise_prior_scale"],
            largest=ALL_INPUTS["largest_set"],
            seed=config["seed"],
        script:
            "../scripts/call.py"

    INPUTS_RESULTS = [
        *rules.judge_inputs_emulator.output,
        *rules.train_on_inputs.output,
        *expand(rules.average_models.output, subject=SUBJECTS),
    ]
