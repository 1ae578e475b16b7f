"""All tables, as CSV and LaTeX: what each is made from, and one rule for each.

A table is made by the function that `call` names; its caption is `report/table_<name>.rst`.
"""

# Category of the report, function, inputs and params; of some, the file's name with its wildcards.
TABULATED = {
    "architectures": {
        "category": "Emulator",
        "call": "tables.emulators:architectures",
        "input": {
            "fits": expand(f"{R}/emulators/{{name}}/fit.json", name=config["emulators"]["names"])
        },
    },
    "ranking": {
        "category": "Emulator",
        "call": "tables.emulators:ranking",
        "input": {"ranking": f"{ESTIMATES}/ranking.csv"}
        | ({"holdout": f"{ESTIMATES}/holdout_ranking.csv"} if "holdout" in SCORED else {}),
    },
    "pairs": {
        "category": "Emulator",
        "call": "tables.emulators:pairs",
        "input": {"pairs": f"{ESTIMATES}/pairs.csv"},
    },
    "transforms": {
        "category": "Emulator",
        "call": "tables.emulators:transforms",
        "input": {"transforms": f"{ESTIMATES}/transforms.csv"},
    },
    "sample_efficiency": {
        "category": "Emulator",
        "call": "tables.emulators:sample_efficiency",
        "input": {"curves": expand(f"{R}/efficiency/{{curve}}.csv", curve=EFFICIENCY_CURVES)},
    },
    "recovery": {
        "category": "Test set",
        "call": "tables.posteriors:recovery",
        "input": {"coverage": f"{POSTERIORS}/test/coverage.csv"},
    },
    "variance_ratios": {
        "category": "Test set",
        "call": "tables.posteriors:variance_ratios",
        "input": {"coverages": lambda wildcards: of_shortlist("coverage.csv")},
        "params": OF_PARAMETERS,
    },
    "choice": {
        "category": "Test set",
        "call": "tables.posteriors:choice",
        "input": {"choice": CHOICE},
    },
    "diagnostics": {
        "category": "Test set",
        "call": "tables.posteriors:diagnostics",
        "input": {
            "shortlist": lambda wildcards: of_shortlist("diagnostics.csv"),
            "scenarios": expand(
                f"{POSTERIORS}/{{name}}/diagnostics.csv", name=[*SCENARIOS, *NOISY]
            ),
            "subjects": expand(f"{POSTERIORS}/subjects/{{subject}}.csv", subject=SUBJECTS),
        },
    },
    "scenarios": {
        "category": "Scenarios",
        "call": "tables.posteriors:scenarios",
        "input": {
            "coverages": expand(f"{POSTERIORS}/{{name}}/coverage.csv", name=SETS),
            "areas": expand(f"{POSTERIORS}/{{name}}/auc.csv", name=[*SCENARIOS, *NOISY]),
            "recoveries": expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=SETS),
        },
        "params": OF_PARAMETERS,
    },
    "subjects": {
        "category": "Subjects",
        "call": "tables.subjects:subjects",
        "input": {
            "posteriors": expand(ANSWER["posterior"], subject=SUBJECTS),
            **{
                name: expand(ANSWER[key], subject=SUBJECTS)
                for name, key in (("diagnostics", "diagnostics"), ("findings", "findings"))
                if key in ANSWER
            },
        },
        "params": {"sources": [SUBJECT_SOURCES[subject] for subject in SUBJECTS]},
    },
    "convergence": {
        "category": "Subjects",
        "call": "tables.subjects:convergence",
        "file": "{subject}/convergence",
        "input": SUBJECT,
    },
    "noise_prior": {
        "category": "Subjects",
        "call": "tables.subjects:noise_prior",
        "file": "{subject}/noise_prior",
        "input": {"noise_prior": f"{POSTERIORS}/subjects/{{subject}}_noise_prior.csv"},
    },
}

for name, table in TABULATED.items():
    file = table.get("file", name)

    rule:
        name:
            f"make_table_{name}"
        input:
            **table["input"],
        output:
            csv=report(
                f"{R}/tables/{file}.csv",
                caption=f"../report/table_{name}.rst",
                category=table["category"],
                subcategory="{subject}" if "{subject}" in file else None,
            ),
            tex=f"{R}/tables/{file}.tex",
        log:
            f"{LOGS}/tables/{file}.log",
        localrule: True
        params:
            **table.get("params", {}),
            call=table["call"],
        script:
            "../scripts/call.py"


EVALUATING_TABLES = [
    *COMPARISON_TABLES,
    *("choice", "diagnostics", "recovery", "variance_ratios"),
    *(["scenarios"] if SCENARIOS else []),
    *(f"{subject}/noise_prior" for subject in NOISE_INFERRED),
]
TABLES = expand(
    f"{R}/tables/{{name}}.{{ext}}",
    name=[
        *(["subjects"] if SUBJECTS else []),
        *(f"{subject}/convergence" for subject in SUBJECTS if ALONE),
        *(EVALUATING_TABLES if EVALUATION else []),
    ],
    ext=["csv", "tex"],
)
