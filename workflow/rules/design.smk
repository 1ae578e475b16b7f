"""Where to simulate: the Sobol sets."""


rule make_design:
    output:
        train=LAYOUT.design("train"),
        test=LAYOUT.design("test"),
    log:
        f"{LOGS}/design/make_design.log",
    localrule: True
    params:
        call="simulation.sobol:write_stiffness_design",
        design={key: config["design"][key] for key in ("natural", "log", "test")},
    script:
        "../scripts/call.py"


rule draw_scenario:
    """Ventricles with simulated disease."""
    output:
        table=LAYOUT.design("{scenario}"),
    log:
        f"{LOGS}/design/draw_scenario-{{scenario}}.log",
    wildcard_constraints:
        scenario=any_of(SCENARIOS),
    localrule: True
    params:
        call="paper.scenarios:write_scenario",
        name=lambda wildcards: wildcards.scenario,
        scenario=lambda wildcards: SCENARIOS[wildcards.scenario],
    script:
        "../scripts/call.py"
