"""What is learnt from: simulations that converged, or finished ones out of tables."""

if FROM_TABLES:

    rule import_simulations:
        """Checked and in the project's order; a test set without a table is held out of `train`."""
        input:
            inputs=lambda wildcards: simulation_table(wildcards.set, "inputs"),
            outputs=lambda wildcards: simulation_table(wildcards.set, "outputs"),
            library=library("simulation_tables"),
        output:
            f"{R}/screening/{{set}}.parquet",
        params:
            own_test="test" in TABLE_SETS,
            holdout=config["simulations"]["holdout"],
            rows=config["simulations"]["rows"],
            bounds=BOUNDS,
            seed=config["seed"],
        wildcard_constraints:
            set="|".join(["train", "test", *TABLE_SETS]),
        log:
            f"{LOGS}/screening/{{set}}.log",
        conda:
            "../../envs/statistics.yaml"
        script:
            "../scripts/import_simulations.py"

else:

    rule screen_simulations:
        input:
            batches=lambda wildcards: expand(
                f"{R}/simulations/{wildcards.set}/{{batch}}.parquet",
                batch=SIMULATION_BATCHES[wildcards.set],
            ),
            library=library("screening"),
        output:
            kept=f"{R}/screening/{{set}}.parquet",
            excluded=f"{R}/screening/{{set}}_excluded.csv",
            summary=f"{R}/screening/{{set}}_summary.csv",
        params:
            bounds=BOUNDS,
        wildcard_constraints:
            set=any_of(SIMULATION_BATCHES),
        log:
            f"{LOGS}/screening/{{set}}.log",
        conda:
            "../../envs/statistics.yaml"
        script:
            "../scripts/screen_simulations.py"
