"""The paper's numbers beside this study's, if it has the paper's parameters."""

from regional_lv.paper import path as papers  # noqa: E402

# The paper's volunteer is that of its vector of strains, not of one frame or of some slices.
VOLUNTEER_FILES = [
    file
    for subject in [s for s in VOLUNTEERS if config["subjects"][s]["frame"] is None][:1]
    for file in (
        LAYOUT.table(f"{subject}/convergence", "csv"),
        *(
            LAYOUT.figure(f"{subject}/{name}_as_it_is", "csv")
            for name in ("bullseye_posterior", "posterior_predictive")
        ),
    )
]

if PARAMETERS.of_paper:
    TABULATED["paper_comparison"] = {
        "job": "paper",
        "category": "Paper",
        "call": "paper.comparison:compare_study",
        "text": "md",
        "input": {
            "numbers": given(os.path.relpath(papers("numbers.csv"))),
            "reasons": given(os.path.relpath(papers("differences.csv"))),
            "screened": expand(LAYOUT.screened("{name}"), name=["train", "test", *SCENARIOS]),
            "explained": EXPLAINED,
            "coverage": lambda wildcards: [
                *of_shortlist("coverage.csv"),
                POSTERIORS.of_set("test", "coverage"),
            ],
            "diagnostics": lambda wildcards: [
                *of_shortlist("diagnostics.csv"),
                POSTERIORS.of_set("test", "diagnostics"),
            ],
            "zone_correlations": expand(
                POSTERIORS.of_set("{name}", "zone_correlations"), name=SCENARIOS
            ),
            "volunteer": VOLUNTEER_FILES,
            "estimates": [LAYOUT.compared("ranking"), LAYOUT.compared("pairs")],
            "choice": CHOICE,
        },
    }
