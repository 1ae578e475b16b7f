"""All figures, data beside every one: what each is drawn from, and by which job (`shown.smk`).

A figure is drawn by `draw` of the module `plots.<name>`, those that only the comparison with the
paper has by that of `paper.plots.<name>`; its caption is `report/<name>.rst`, or what `caption`
names in its place.
"""

POSTERIORS = LAYOUT.posteriors(EMULATOR)
CHOICE = f"{R}/posteriors/final.json"
LOCAL = [name for name, scenario in SCENARIOS.items() if scenario["kind"] == "local"]
GLOBAL = [name for name in SCENARIOS if name not in LOCAL]
# What leaves zones at baseline: of one zone, there is no other.
HEALTHY_BESIDE = LOCAL if len(PARAMETERS.zones) > 1 else []
SCENARIO_LABELS = labels_of(SCENARIOS)
LABELS = list(SCENARIO_LABELS.values())
RECOVERIES = expand(POSTERIORS.of_set("{name}", "recovery"), name=[*SCENARIOS, *NOISY])
BULLSEYES = {
    "local": (LOCAL, "stiffened", "Local stiffening"),
    "global": (GLOBAL, "stiffened", "Global stiffening"),
    "baseline": (HEALTHY_BESIDE, "baseline", "Local stiffening"),
}
NOISE_TITLES = {"": "", "-noisy": ", with measurement noise"}
TRACED = {
    "emulator_traces": list(PARAMETERS.names[: len(PARAMETERS.factors)]),
    "emulator_traces_all": list(PARAMETERS.names),
}
# The same of the model as it is, by the emulator of the stiffness alone.
SUBJECT = {
    "posterior": POSTERIORS.of_subject("{subject}", "nc"),
    "diagnostics": POSTERIORS.of_subject("{subject}", "csv"),
}
# What a subject's figures, tables and pages show: averaged over models.
ANSWER = {"posterior": LAYOUT.posterior("{subject}"), "findings": LAYOUT.findings("{subject}")}
TRUTH = {
    "truth": lambda wildcards: (
        LAYOUT.truth(wildcards.subject) if wildcards.subject in SYNTHETIC else []
    )
}
SOURCE_OF = {"source": lambda wildcards: SUBJECT_SOURCES[wildcards.subject]}

EXPLAINED = LAYOUT.explained_variance

# Job, category of the report, inputs and params, among them files that the same job has made; of
# some, the name of the file and that of the module (`of`).
PLOTS = {
    "zones": {
        "job": "heart",
        "category": "Geometry",
        "input": {"mesh": LAYOUT.heart().mesh},
    },
    "mesh": {
        "job": "heart",
        "category": "Geometry",
        "input": {"mesh": LAYOUT.heart().mesh},
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
            "predictions": LAYOUT.predictions(EMULATOR, "test"),
            "choice": CHOICE,
        },
    },
    "per_sample_mse": {
        "job": "comparison",
        "category": "Emulator",
        "input": {
            "estimates": expand(
                LAYOUT.estimates("{name}", "test"), name=config["emulators"]["names"]
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
            "recovery": POSTERIORS.of_set("test", "recovery"),
            "coverage": POSTERIORS.of_set("test", "coverage"),
            "diagnostics": POSTERIORS.of_set("test", "diagnostics"),
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
                "errors": POSTERIORS.of_set("test", "map_mse"),
                "posteriors": lambda wildcards: of_shortlist(
                    *(f"batch-{batch}.nc" for batch in posterior_batches("test"))
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
            "ranks": POSTERIORS.checked("sbc"),
            "tests": POSTERIORS.checked("sbc_test"),
            "choice": CHOICE,
        },
    },
    "sampler_agreement": {
        "job": "checks",
        "category": "Test set",
        "input": {
            "agreement": [
                *expand(
                    POSTERIORS.of_set("{set}", "sampler_agreement"),
                    set=["test", *SCENARIOS, *NOISY],
                ),
                *expand(
                    POSTERIORS.of_subject("{subject}_sampler_agreement", "csv"), subject=SUBJECTS
                ),
            ]
        },
    },
    "map_errors": {
        "job": "scenarios",
        "category": "Scenarios",
        "input": {
            "recoveries": RECOVERIES,
        },
        "params": {"labels": LABELS},
    },
    **{
        f"bullseye_{which}{noise}": {
            "job": "scenarios",
            "category": "Scenarios",
            "of": "bullseye_map",
            "input": {
                "recoveries": [POSTERIORS.of_set(f"{name}{noise}", "recovery") for name in sets]
            },
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
        f"{file}{noise}": {
            "job": "scenarios",
            "category": "Scenarios",
            "of": "correlations",
            "input": {
                kind: [POSTERIORS.of_set(f"{name}{noise}", table) for name in sets]
                for kind, table in {
                    "correlations": f"{'zone_' if of == 'zones' else ''}correlations",
                    "recoveries": "recovery",
                }.items()
            },
            "params": {
                "labels": [SCENARIO_LABELS[name] for name in sets],
                "title": f"Posterior correlations of {of}{noise_title}: mean ± standard error",
            },
        }
        for noise, noise_title in NOISE_TITLES.items()
        for of, file, sets in (
            ("zones", "zone_correlations", list(SCENARIOS)),
            *(("parameters", f"correlations/{name}", [name]) for name in SCENARIOS),
        )
    },
    "hpd_widths": {
        "job": "scenarios",
        "category": "Scenarios",
        "input": {
            "recoveries": RECOVERIES,
        },
        "params": {"labels": LABELS},
    },
    "measured_strains": {
        "job": "subject",
        "category": "Subjects",
        "file": "{subject}/measured_strains",
        "input": {"measured": LAYOUT.measured("{subject}")},
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
        "input": {"noise_prior": POSTERIORS.of_subject("{subject}_noise_prior", "csv")},
        "params": SOURCE_OF,
    },
}
if HEALTHY_BESIDE:
    PLOTS["roc"] = {
        "job": "scenarios",
        "category": "Scenarios",
        "input": {
            "curves": expand(POSTERIORS.of_set("{name}", "roc"), name=[*SCENARIOS, *NOISY]),
            "areas": expand(POSTERIORS.of_set("{name}", "auc"), name=[*SCENARIOS, *NOISY]),
            "recoveries": RECOVERIES,
        },
        "params": {"labels": LABELS},
    }
if not FROM_TABLES:
    PLOTS["resimulation"] = {
        "job": "checks",
        "category": "Test set",
        "input": {"resimulated": POSTERIORS.checked("resimulated")},
    }
    PLOTS["design"] = {
        "job": "design",
        "category": "Simulations",
        "input": {
            "simulations": LAYOUT.screened("train"),
            "excluded": LAYOUT.excluded("train"),
        },
    }

# The paper's figures of a subject.
for name in ("bullseye_posterior", "posterior_predictive"):
    PLOTS[f"{name}_as_it_is"] = PLOTS[name] | {
        "job": "subject_as_it_is",
        "file": f"{{subject}}/{name}_as_it_is",
        "input": SUBJECT | TRUTH if name == "bullseye_posterior" else SUBJECT,
        "of": name,
        "caption": f"{name}_as_it_is",
    }
