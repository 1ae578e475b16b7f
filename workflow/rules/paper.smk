"""The paper's numbers beside this study's, if it has the paper's parameters."""

from regional_lv.paper import path as papers  # noqa: E402

# The paper has one volunteer: the first of the study's that is theirs.
VOLUNTEER_FILES = [
    file
    for subject in VOLUNTEERS[:1]
    for file in (
        f"{R}/tables/{subject}/convergence.csv",
        *(
            f"{R}/figures/{subject}/{name}{'_as_it_is' if DOUBTS else ''}.csv"
            for name in ("bullseye_posterior", "posterior_predictive")
        ),
    )
]

if PARAMETERS.names == StiffnessInputs().names:
    TABULATED["paper_comparison"] = {
        "job": "paper",
        "category": "Paper",
        "call": "paper.comparison:compare_study",
        "text": "md",
        "input": {
            "numbers": given(os.path.relpath(papers("numbers.csv"))),
            "reasons": given(os.path.relpath(papers("differences.csv"))),
            "screened": expand(
                f"{R}/screening/{{name}}.parquet", name=["train", "test", *SCENARIOS]
            ),
            "explained": EXPLAINED,
            "coverage": lambda wildcards: [
                *of_shortlist("coverage.csv"),
                f"{POSTERIORS}/test/coverage.csv",
            ],
            "diagnostics": lambda wildcards: [
                *of_shortlist("diagnostics.csv"),
                f"{POSTERIORS}/test/diagnostics.csv",
            ],
            "zone_correlations": expand(
                f"{POSTERIORS}/{{name}}/zone_correlations.csv", name=SCENARIOS
            ),
            "volunteer": VOLUNTEER_FILES,
            "estimates": [f"{ESTIMATES}/ranking.csv", f"{ESTIMATES}/pairs.csv"],
            "choice": CHOICE,
        },
    }
