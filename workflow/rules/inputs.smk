"""All inputs that are not fixed (`inputs`): a design over them, simulations with the derivatives
about each, and one emulator."""

ALL_INPUTS = config["all_inputs"]
OVER_INPUTS = f"{R}/all_inputs"
INPUTS_SIZES = {"train": ALL_INPUTS["simulations"], "test": ALL_INPUTS["test"]}
INPUTS_BATCHES = {
    name: batches(size, config["simulations"]["batch_size"]) for name, size in INPUTS_SIZES.items()
}
INPUTS_ANCHORS = min(ALL_INPUTS["anchors"], ALL_INPUTS["simulations"])
INPUTS_ANCHOR_BATCHES = batches(INPUTS_ANCHORS, -(-INPUTS_ANCHORS // 2))
# Whose shapes they are of.
DESIGN = {
    "study": "simulation.design:write_inputs_design",
    "population": "hearts.design:write_population_design",
}[ALL_INPUTS["shapes"]]
# Whether the simulations join the emulator of any heart, which comes with the package; the anchors,
# which are simulated first, ask it whether it knows this one.
JOINED = not FROM_TABLES and ALL_INPUTS["emulator"] == "shipped"
# Simulations that are made on the finer mesh as well.
FINER = min(ALL_INPUTS["finer"], INPUTS_ANCHORS)
# Of what subjects are answered by. Tables are of the stiffness alone.
EMULATOR_OF_INPUTS = (
    LAYOUT.emulator(EMULATOR)
    if FROM_TABLES
    else (
        given(os.path.relpath(SHIPPED))
        if JOINED
        else f"{OVER_INPUTS}/{'finer/' if FINER else ''}emulator.pt"
    )
)
INPUTS = sections_of_stiffness(config) if FROM_TABLES else sections_of(config)
STUDIED = Inputs.from_config(INPUTS)
# Whether there is an emulator of the stiffness alone.
ALONE = EVALUATION or FROM_TABLES

if not FROM_TABLES:
    SIMULATED = STUDIED.simulated
    COORDINATES = SIMULATED.coordinates.spec()
    SUSPECTED = SIMULATED.subset(SIMULATED.of_role("suspected"))

    use rule solve_baseline as solve_inputs_baseline with:
        input:
            mesh=LAYOUT.heart("{mesh_folder}").mesh,
        output:
            start=f"{OVER_INPUTS}/{{mesh_folder}}baseline.npz",
            summary=f"{OVER_INPUTS}/{{mesh_folder}}baseline.json",
        log:
            f"{LOGS}/all_inputs/{{mesh_folder}}solve_baseline.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/{{mesh_folder}}solve_baseline.tsv"
        params:
            call="simulation.batches:solve_baseline",
            physics=INPUTS,

    rule solve_inputs_anchors:
        input:
            **({"emulator_file": EMULATOR_OF_INPUTS} if JOINED else {}),
            mesh=LAYOUT.heart("{mesh_folder}").mesh,
            start=f"{OVER_INPUTS}/{{mesh_folder}}baseline.npz",
        output:
            design=f"{OVER_INPUTS}/{{mesh_folder}}anchors/design-{{batch}}.parquet",
            fields=f"{OVER_INPUTS}/{{mesh_folder}}anchors/batch-{{batch}}.npz",
            simulations=f"{OVER_INPUTS}/{{mesh_folder}}anchors/batch-{{batch}}.parquet",
        log:
            f"{LOGS}/all_inputs/{{mesh_folder}}solve_anchors-{{batch}}.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/{{mesh_folder}}anchors/batch-{{batch}}.tsv"
        priority: FIRST
        threads: 1
        resources:
            **needs(mem_mb=4000, minutes=120),
        params:
            calls={
                "design": "hearts.full:write_inputs_design" if JOINED else DESIGN,
                "anchors": "simulation.batches:solve_anchors",
            },
            physics=INPUTS,
            set="train",
            size=anchors_of,
            anchors=anchors_of,
            batches=len(INPUTS_ANCHOR_BATCHES),
        script:
            "../scripts/call.py"

    use rule fit_predictor as fit_inputs_predictor with:
        input:
            anchors=expand(
                f"{OVER_INPUTS}/{{{{mesh_folder}}}}anchors/batch-{{batch}}.npz",
                batch=INPUTS_ANCHOR_BATCHES,
            ),
        output:
            predictor=LAYOUT.inputs_predictor("{mesh_folder}"),
        log:
            f"{LOGS}/all_inputs/{{mesh_folder}}fit_predictor.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/{{mesh_folder}}fit_predictor.tsv"
        params:
            call="mechanics.predictor:fit_predictor",
            physics=INPUTS,

    rule simulate_inputs:
        input:
            mesh=LAYOUT.heart().mesh,
            predictor=LAYOUT.inputs_predictor(),
            anchors=lambda wildcards: (
                expand(
                    f"{OVER_INPUTS}/anchors/batch-{{batch}}.parquet", batch=INPUTS_ANCHOR_BATCHES
                )
                if wildcards.set == "train"
                else []
            ),
        output:
            design=f"{OVER_INPUTS}/design/{{set}}/batch-{{batch}}.parquet",
            simulations=f"{OVER_INPUTS}/simulations/{{set}}/batch-{{batch}}.parquet",
        log:
            f"{LOGS}/all_inputs/simulations/{{set}}/batch-{{batch}}.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/simulations/{{set}}/batch-{{batch}}.tsv"
        wildcard_constraints:
            set=any_of(INPUTS_BATCHES),
        priority: FIRST
        threads: 1
        resources:
            **needs(minutes=60),
        params:
            calls={"design": DESIGN, "simulations": "simulation.batches:simulate_batch"},
            physics=INPUTS,
            size=rows_drawn,
            batch_size=config["simulations"]["batch_size"],
        script:
            "../scripts/call.py"

    rule screen_inputs:
        input:
            batches=lambda wildcards: expand(
                f"{OVER_INPUTS}/simulations/{wildcards.set}/batch-{{batch}}.parquet",
                batch=INPUTS_BATCHES[wildcards.set],
            ),
        output:
            kept=LAYOUT.inputs_screened("{set}"),
            excluded=f"{OVER_INPUTS}/{{set}}_excluded.csv",
            summary=f"{OVER_INPUTS}/{{set}}_summary.csv",
        log:
            f"{LOGS}/all_inputs/screen_{{set}}.log",
        wildcard_constraints:
            set=any_of(INPUTS_BATCHES),
        localrule: True
        params:
            call="simulation.screening:screen_simulations",
            parameters=COORDINATES,
            steepest=ALL_INPUTS["steepest"],
        script:
            "../scripts/call.py"

    use rule train_emulator as train_on_inputs with:
        input:
            train=LAYOUT.inputs_screened("train"),
        output:
            emulator_file=f"{OVER_INPUTS}/emulator.pt",
            report=f"{OVER_INPUTS}/fit.json",
        log:
            f"{LOGS}/all_inputs/train.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/train.tsv"
        resources:
            **needs(mem_mb=6000, minutes=240),
        params:
            call="emulators.training:train_emulator",
            name=OF_INPUTS,
            settings=config["emulators"][OF_INPUTS],
            parameters=COORDINATES,

    rule judge_inputs_emulator:
        """By how many of the suspected inputs are on."""
        input:
            emulator_file=f"{OVER_INPUTS}/emulator.pt",
            test=LAYOUT.inputs_screened("test"),
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

    rule train_on_finer_mesh:
        """What a finer mesh changes, of all inputs."""
        input:
            emulator_file=f"{OVER_INPUTS}/emulator.pt",
            coarse=expand(
                f"{OVER_INPUTS}/anchors/batch-{{batch}}.parquet", batch=INPUTS_ANCHOR_BATCHES
            ),
            finer=expand(
                f"{OVER_INPUTS}/finer/anchors/batch-{{batch}}.parquet", batch=INPUTS_ANCHOR_BATCHES
            ),
        output:
            corrected_file=f"{OVER_INPUTS}/finer/emulator.pt",
            report=f"{OVER_INPUTS}/finer/fit.json",
        log:
            f"{LOGS}/all_inputs/train_on_finer_mesh.log",
        benchmark:
            f"{R}/benchmarks/all_inputs/train_on_finer_mesh.tsv"
        priority: FIRST
        threads: 1
        params:
            call="emulators.finer:train_finer",
            parameters=COORDINATES,
        script:
            "../scripts/call.py"

    INPUTS_RESULTS = (
        [LAYOUT.inputs_screened("train")]
        if JOINED
        else [*rules.judge_inputs_emulator.output, *rules.train_on_inputs.output]
    )
    if ALL_INPUTS["shapes"] == "population":

        rule heart_emulator:
            """The emulator of any heart, as it comes with the package."""
            input:
                emulator_file=EMULATOR_OF_INPUTS,
                test=LAYOUT.inputs_screened("test"),
                summary=f"{OVER_INPUTS}/train_summary.csv",
            output:
                shipped=f"{R}/heart_emulator.pt.gz",
            log:
                f"{LOGS}/all_inputs/heart_emulator.log",
            threads: 1
            params:
                call="hearts.card:ship",
                physics=INPUTS,
                mesh=config["mesh"],
            script:
                "../scripts/call.py"
