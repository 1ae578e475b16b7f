"""All figures, data beside every one: what each is drawn from, and by which job (`shown.smk`).

A figure is drawn by `draw` of the module `plots.<name>`, those that only the comparison with the
paper has by that of `paper.plots.<name>`; its caption is `report/<name>.rst`.
"""

POSTERIORS = f"{R}/posteriors/{EMULATOR}"
CHOICE = f"{R}/posteriors/final.json"
LOCAL = [name for name, scenario in SCENARIOS.items() if scenario["kind"] == "local"]
GLOBAL = [name for name in SCENARIOS if name not in LOCAL]
SCENARIO_LABELS = {
    name: f"{scenario['kind']}, μ = {scenario['mu']:g}" for name, scenario in SCENARIOS.items()
}
LABELS = list(SCENARIO_LABELS.values())
BULLSEYES = {
    "local": (LOCAL, "stiffened", "Local stiffening"),
    "global": (GLOBAL, "stiffened", "Global stiffening"),
    "baseline": (LOCAL, "baseline", "Local stiffening"),
}
NOISE_TITLES = {"": "", "-noisy": ", with measurement noise"}
TRACED = {
    "emulator_traces": list(PARAMETERS.names[: len(PARAMETERS.factors)]),
    "emulator_traces_all": list(PARAMETERS.names),
}
SUBJECT = {
    "posterior": f"{POSTERIORS}/subjects/{{subject}}.nc",
    "diagnostics": f"{POSTERIORS}/subjects/{{subject}}.csv",
}
# What a subject's figures, tables and pages show: averaged over models, where these are doubted.
ANSWER = (
    {
        "posterior": f"{C}/{{subject}}/posterior.nc",
        "diagnostics": [],
        "findings": f"{C}/{{subject}}/findings.json",
    }
    if DOUBTS
    else SUBJECT
)
TRUTH = {
    "truth": lambda wildcards: (
        f"{R}/truth/{wildcards.subject}.json" if wildcards.subject in SYNTHETIC else []
    )
}
SOURCE_OF = {"source": lambda wildcards: SUBJECT_SOURCES[wildcards.subject]}

EXPLAINED = f"{R}/reduction/explained_variance.csv"

# Job, category of the report, inputs and params, among them files that the same job has made; of
# some, the name of the file and that of the module (`of`).
PLOTS = {
    "zones": {
        "job": "heart",
        "category": "Geometry",
        "input": {"mesh": f"{R}/geometry/mesh.vtu"},
    },
    "mesh": {
        "job": "heart",
        "category": "Geometry",
        "input": {"mesh": f"{R}/geometry/mesh.vtu"},
    },
    "strain_field": {
        "job": "strain_field",
        "category": "Geometry",
        "params": {"vtu": written("strains.vtu"), "strains": written("strains.table")},
    },
    "explained_variance": {
        "job": "design",
        "category": "Emulator",
        "params": {
            "explained": written("reduction.explained"),
            "threshold": config["reduction"]["explained_variance"],
        },
    },
    "parity": {
        "job": "test_set",
        "category": "Emulator",
        "input": {
            "predictions": f"{R}/emulators/{EMULATOR}/test_predictions.parquet",
            "choice": CHOICE,
        },
    },
    "per_sample_mse": {
        "job": "comparison",
        "category": "Emulator",
        "input": {
            "estimates": expand(
                f"{ESTIMATES}/{{name}}/test.parquet", name=config["emulators"]["names"]
            ),
            "shortlist": SHORTLIST,
        },
        "params": {"names": config["emulators"]["names"]},
    },
    "sample_efficiency": {
        "job": "efficiency",
        "category": "Emulator",
        "input": {"curves": expand(f"{R}/efficiency/{{curve}}.csv", curve=EFFICIENCY_CURVES)},
    },
    "recovery": {
        "job": "test_set",
        "category": "Test set",
        "input": {
            "recovery": f"{POSTERIORS}/test/recovery.csv",
            "coverage": f"{POSTERIORS}/test/coverage.csv",
            "diagnostics": f"{POSTERIORS}/test/diagnostics.csv",
            "choice": CHOICE,
        },
    },
    "uncertainty": {
        "job": "test_set",
        "category": "Test set",
        "input": {
            "coverages": lambda wildcards: of_shortlist("coverage.csv"),
            "errors": lambda wildcards: of_shortlist("map_mse.csv"),
        },
    },
    **{
        name: {
            "job": "test_set",
            "category": "Test set",
            "of": "emulator_traces",
            "input": {
                "errors": f"{POSTERIORS}/test/map_mse.csv",
                "posteriors": lambda wildcards: of_shortlist(
                    *(f"{batch}.nc" for batch in posterior_batches("test"))
                ),
                "diagnostics": lambda wildcards: of_shortlist("diagnostics.csv"),
            },
            "params": {"shown": shown},
        }
        for name, shown in TRACED.items()
    },
    "sbc": {
        "job": "checks",
        "category": "Test set",
        "input": {
            "ranks": f"{POSTERIORS}/sbc.csv",
            "tests": f"{POSTERIORS}/sbc_test.csv",
            "choice": CHOICE,
        },
    },
    "sampler_agreement": {
        "job": "checks",
        "category": "Test set",
        "input": {
            "agreement": [
                *expand(
                    f"{POSTERIORS}/{{set}}/sampler_agreement.csv", set=["test", *SCENARIOS, *NOISY]
                ),
                *expand(
                    f"{POSTERIORS}/subjects/{{subject}}_sampler_agreement.csv", subject=SUBJECTS
                ),
            ]
        },
    },
    "map_errors": {
        "job": "scenarios",
        "category": "Scenarios",
        "input": {
            "recoveries": expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=SCENARIOS),
            "noisy": expand(f"{POSTERIORS}/{{name}}-noisy/recovery.csv", name=SCENARIOS),
        },
        "params": {"labels": LABELS},
    },
    **{
        f"bullseye_{which}{noise}": {
            "job": "scenarios",
            "category": "Scenarios",
            "of": "bullseye_map",
            "input": {"recoveries": [f"{POSTERIORS}/{name}{noise}/recovery.csv" for name in sets]},
            "params": {
                "labels": [SCENARIO_LABELS[name] for name in sets],
                "zones": zones,
                "title": title + noise_title,
            },
        }
        for which, (sets, zones, title) in BULLSEYES.items()
        for noise, noise_title in NOISE_TITLES.items()
        if sets
    },
    **{
        f"zone_correlations{noise}": {
            "job": "scenarios",
            "category": "Scenarios",
            "of": "zone_correlations",
            "input": {
                "correlations": [
                    f"{POSTERIORS}/{name}{noise}/zone_correlations.csv" for name in SCENARIOS
                ],
                "recoveries": [f"{POSTERIORS}/{name}{noise}/recovery.csv" for name in SCENARIOS],
            },
            "params": {
                "labels": LABELS,
                "title": f"Posterior correlations of zones{noise_title}: mean ± standard error",
            },
        }
        for noise, noise_title in NOISE_TITLES.items()
    },
    **{
        f"correlations/{name}{noise}": {
            "job": "scenarios",
            "category": "Scenarios",
            "of": "correlations",
            "input": {
                "correlations": f"{POSTERIORS}/{name}{noise}/correlations.csv",
                "recovery": f"{POSTERIORS}/{name}{noise}/recovery.csv",
            },
            "params": {"label": label + noise_title},
        }
        for name, label in SCENARIO_LABELS.items()
        for noise, noise_title in NOISE_TITLES.items()
    },
    "hpd_widths": {
        "job": "scenarios",
        "category": "Scenarios",
        "input": {
            "recoveries": expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=SCENARIOS),
            "noisy": expand(f"{POSTERIORS}/{{name}}-noisy/recovery.csv", name=SCENARIOS),
        },
        "params": {"labels": LABELS},
    },
    "measured_strains": {
        "job": "subject",
        "category": "Subjects",
        "file": "{subject}/measured_strains",
        "input": {"measured": f"{R}/measured/{{subject}}.csv"},
        "params": SOURCE_OF,
    },
    "bullseye_posterior": {
        "job": "subject",
        "category": "Subjects",
        "file": "{subject}/bullseye_posterior",
        "input": ANSWER | TRUTH,
        "params": SOURCE_OF,
    },
    "posterior_predictive": {
        "job": "subject",
        "category": "Subjects",
        "file": "{subject}/posterior_predictive",
        "input": ANSWER,
        "params": SOURCE_OF,
    },
    "traces": {
        "job": "subject_as_it_is",
        "category": "Subjects",
        "file": "{subject}/traces",
        "input": SUBJECT | TRUTH,
        "params": SOURCE_OF,
    },
    "noise_prior": {
        "job": "noise_prior",
        "category": "Subjects",
        "file": "{subject}/noise_prior",
        "input": {"noise_prior": f"{POSTERIORS}/subjects/{{subject}}_noise_prior.csv"},
        "params": SOURCE_OF,
    },
}
if LOCAL:
    PLOTS["roc"] = {
        "job": "scenarios",
        "category": "Scenarios",
        "input": {
            "curves": expand(f"{POSTERIORS}/{{name}}/roc.csv", name=[*SCENARIOS, *NOISY]),
            "areas": expand(f"{POSTERIORS}/{{name}}/auc.csv", name=[*SCENARIOS, *NOISY]),
            "recoveries": expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=[*SCENARIOS, *NOISY]),
        },
        "params": {"labels": LABELS},
    }
if not FROM_TABLES:
    PLOTS["resimulation"] = {
        "job": "checks",
        "category": "Test set",
        "input": {"resimulated": f"{POSTERIORS}/resimulated.csv"},
    }
    PLOTS["design"] = {
        "job": "design",
        "category": "Simulations",
        "input": {
            "simulations": f"{R}/screening/train.parquet",
            "excluded": f"{R}/screening/train_excluded.csv",
        },
    }

# The same of the model as it is, by the emulator of the stiffness alone: the paper's figures.
if ALONE and DOUBTS:
    for name in ("bullseye_posterior", "posterior_predictive"):
        PLOTS[f"{name}_as_it_is"] = PLOTS[name] | {
            "job": "subject_as_it_is",
            "file": f"{{subject}}/{name}_as_it_is",
            "input": SUBJECT | TRUTH if name == "bullseye_posterior" else SUBJECT,
            "of": name,
        }
