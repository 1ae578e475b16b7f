"""Training and test data: simulations that converged, or finished ones from tables."""

if FROM_TABLES:

    rule import_simulations:
        """Checked and in the project's order; what has no table of its own is held out of `train`."""
        input:
            inputs=lambda wildcards: simulation_table(wildcards.set, "inputs"),
            outputs=lambda wildcards: simulation_table(wildcards.set, "outputs"),
        output:
            kept=LAYOUT.screened("{set}"),
        log:
            f"{LOGS}/screening/{{set}}.log",
        wildcard_constraints:
            set=any_of(["train", *SCORED, *TABLE_SETS]),
        localrule: True
        params:
            call="simulation.tables:import_simulations",
            own_test="test" in TABLE_SETS,
            holdout=config["simulations"]["holdout"],
            rows=config["simulations"]["rows"],
            stiff=lambda wildcards: (
                stiff_zones(SCENARIOS[wildcards.set], PARAMETERS)
                if wildcards.set in SCENARIOS
                else []
            ),
        script:
            "../scripts/call.py"

else:

    rule screen_simulations:
        input:
            batches=lambda wildcards: expand(
                LAYOUT.simulations(wildcards.set, "{batch}"),
                batch=SIMULATION_BATCHES[wildcards.set],
            ),
        output:
            kept=LAYOUT.screened("{set}"),
            excluded=LAYOUT.excluded("{set}"),
            summary=LAYOUT.screening_summary("{set}"),
        log:
            f"{LOGS}/screening/{{set}}.log",
        wildcard_constraints:
            set=any_of({*SIMULATION_BATCHES} - {"resimulated"}),
        priority: FIRST
        localrule: True
        params:
            call="simulation.screening:screen_simulations",
        script:
            "../scripts/call.py"
