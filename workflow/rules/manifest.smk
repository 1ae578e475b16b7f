"""What a study was made with and what it took, and checksums of what it shows and of what stands
behind that."""

SHOWN = [
    *FIGURES,
    *TABLES,
    *SUMMARIES,
    *rules.criticism.input,
    *([] if FROM_TABLES else INPUTS_RESULTS),
    *PAGES,
]
BEHIND = [
    *expand(LAYOUT.measured("{subject}"), subject=SUBJECTS),
    EMULATOR_OF_INPUTS,
    *(expand(LAYOUT.screened("{name}"), name=["train", "test"]) if ALONE else []),
    *(
        [LAYOUT.emulator(EMULATOR), CHOICE]
        + expand(POSTERIORS.of_subject("{subject}", "nc"), subject=SUBJECTS)
        + [file for name in SETS for file in posterior_files(EMULATOR, name)]
        if EVALUATION
        else []
    ),
    *([] if FROM_TABLES else [LAYOUT.heart().mesh]),
]


rule write_manifest:
    """Logs and benchmarks have no checksums: they say how it went, not what came out."""
    input:
        results=[*SHOWN, *BEHIND],
    output:
        table=f"{R}/benchmarks/costs.csv",
        manifest=LAYOUT.manifest,
    log:
        f"{LOGS}/manifest.log",
    localrule: True
    params:
        calls={
            "costs": "tables.costs:tabulate_costs",
            "manifest": "study.manifest:write_manifest",
        },
        config=config,
        configfiles=lambda wildcards: CONFIG_FILES,  # in a list, braces would be wildcards
        overrides=dict(workflow.config_settings.config),
    script:
        "../scripts/call.py"
