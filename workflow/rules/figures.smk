"""The registry of figures and tables: everything that a reader looks at, data beside every figure."""

POSTERIORS = f"{R}/posteriors/{EMULATOR}"
TRUTHS = {subject: f"{R}/truth/{subject}.json" for subject in SYNTHETIC}
LOCAL = [name for name, scenario in SCENARIOS.items() if scenario["kind"] == "local"]
GLOBAL = [name for name in SCENARIOS if name not in LOCAL]

STUDY_FIGURES = ["zones", "strain_field", "design", "explained_variance", "parity"]
TEST_SET_FIGURES = ["recovery", "uncertainty", "emulator_traces", "emulator_traces_all"]
TRUST_FIGURES = ["sbc", "resimulation", "sampler_agreement"]
LOCAL_FIGURES = [
    *(f"bullseye_{which}{noise}" for which in ("local", "baseline") for noise in ("", "-noisy")),
    "roc",
]
GLOBAL_FIGURES = [f"bullseye_global{noise}" for noise in ("", "-noisy")]
SCENARIO_FIGURES = [
    "map_errors",
    "hpd_widths",
    *(f"zone_correlations{noise}" for noise in ("", "-noisy")),
    *(f"correlations/{name}" for name in [*SCENARIOS, *NOISY]),
]
SUBJECT_FIGURES = ["bullseye_posterior", "posterior_predictive", "traces"]

FIGURES = expand(
    f"{R}/figures/{{name}}.{{ext}}",
    name=[
        *(["explained_variance", "parity"] if FROM_TABLES else STUDY_FIGURES),
        *COMPARISON_FIGURES,
        *TEST_SET_FIGURES,
        *(["sbc", "sampler_agreement"] if FROM_TABLES else TRUST_FIGURES),
        *(LOCAL_FIGURES if LOCAL else []),
        *(GLOBAL_FIGURES if GLOBAL else []),
        *(SCENARIO_FIGURES if SCENARIOS else []),
        *(f"{subject}/{name}" for subject in SUBJECTS for name in SUBJECT_FIGURES),
        *(f"{subject}/noise_prior" for subject in NOISE_INFERRED),
    ],
    ext=["png", "csv"],
)
TABLES = expand(
    f"{R}/tables/{{name}}.{{ext}}",
    name=[
        *COMPARISON_TABLES,
        "choice",
        "diagnostics",
        "recovery",
        "variance_ratios",
        *(["scenarios"] if SCENARIOS else []),
        *(["subjects"] if SUBJECTS else []),
        *(f"{subject}/convergence" for subject in SUBJECTS),
        *(f"{subject}/noise_prior" for subject in NOISE_INFERRED),
    ],
    ext=["csv", "tex"],
) + expand(f"{R}/tables/paper_comparison.{{ext}}", ext=["csv", "md"])
