"""All tables, as CSV and LaTeX: what each is made from, and by which job (`shown.smk`).

A table is made by the function that `call` names; its caption is `report/table_<name>.rst`.
"""

# Job, category of the report, function, inputs and params; of some, the name of the file, and what is
# beside the CSV file where it is not LaTeX (`text`).
TABULATED = {
    "architectures": {
        "job": "comparison",
        "category": "Emulator",
        "call": "paper.tables.emulators:architectures",
        "input": {"fits": expand(LAYOUT.fit("{name}"), name=config["emulators"]["names"])},
    },
    "ranking": {
        "job": "comparison",
        "category": "Emulator",
        "call": "paper.tables.emulators:ranking",
        "input": {"ranking": LAYOUT.compared("ranking")}
        | ({"holdout": LAYOUT.compared("holdout_ranking")} if "holdout" in SCORED else {}),
    },
    "pairs": {
        "job": "comparison",
        "category": "Emulator",
        "call": "paper.tables.emulators:pairs",
        "input": {"pairs": LAYOUT.compared("pairs")},
    },
    "sample_efficiency": {
        "job": "efficiency",
        "category": "Emulator",
        "call": "paper.tables.emulators:sample_efficiency",
        "input": {"curves": expand(f"{R}/efficiency/{{curve}}.csv", curve=EFFICIENCY_CURVES)},
    },
    "recovery": {
        "job": "test_set",
        "category": "Test set",
        "call": "paper.tables.posteriors:recovery",
        "input": {"coverage": POSTERIORS.of_set("test", "coverage")},
    },
    "variance_ratios": {
        "job": "test_set",
        "category": "Test set",
        "call": "paper.tables.posteriors:variance_ratios",
        "input": {"coverages": lambda wildcards: of_shortlist("coverage.csv")},
    },
    "choice": {
        "job": "test_set",
        "category": "Test set",
        "call": "paper.tables.posteriors:choice",
        "input": {"choice": CHOICE},
    },
    "diagnostics": {
        "job": "paper",
        "category": "Test set",
        "call": "paper.tables.posteriors:diagnostics",
        "input": {
            "shortlist": lambda wildcards: of_shortlist("diagnostics.csv"),
            "scenarios": expand(
                POSTERIORS.of_set("{name}", "diagnostics"), name=[*SCENARIOS, *NOISY]
            ),
            "subjects": expand(POSTERIORS.of_subject("{subject}", "csv"), subject=SUBJECTS),
        },
    },
    "scenarios": {
        "job": "scenarios",
        "category": "Scenarios",
        "call": "paper.tables.posteriors:scenarios",
        "input": {
            "coverages": expand(POSTERIORS.of_set("{name}", "coverage"), name=SETS),
            "areas": expand(POSTERIORS.of_set("{name}", "auc"), name=[*SCENARIOS, *NOISY]),
            "recoveries": expand(POSTERIORS.of_set("{name}", "recovery"), name=SETS),
        },
    },
    "subjects": {
        "job": "subjects",
        "category": "Subjects",
        "call": "tables.subjects:subjects",
        "input": {
            "posteriors": expand(ANSWER["posterior"], subject=SUBJECTS),
            "findings": expand(ANSWER["findings"], subject=SUBJECTS),
        },
        "params": {"sources": [SUBJECT_SOURCES[subject] for subject in SUBJECTS]},
    },
    "convergence": {
        "job": "subject_as_it_is",
        "category": "Subjects",
        "call": "paper.tables.posteriors:convergence",
        "file": "{subject}/convergence",
        "input": SUBJECT,
    },
    "noise_prior": {
        "job": "noise_prior",
        "category": "Subjects",
        "call": "paper.tables.posteriors:noise_prior",
        "file": "{subject}/noise_prior",
        "input": {"noise_prior": POSTERIORS.of_subject("{subject}_noise_prior", "csv")},
    },
}
if config["estimates"]["both_transforms"]:
    TABULATED["transforms"] = {
        "job": "comparison",
        "category": "Emulator",
        "call": "paper.tables.emulators:transforms",
        "input": {"transforms": LAYOUT.compared("transforms")},
    }
