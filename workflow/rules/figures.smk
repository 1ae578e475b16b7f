"""All figures, data beside every one: what each is drawn from, and one rule for each.

A figure is drawn by `draw` of the module `plots.<name>`; its caption is `report/<name>.rst`.
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
OF_PARAMETERS = {"parameters": PARAMETER_SPEC}

# Category of the report, inputs and params; of some, the file's name with its wildcards, and what
# these may be.
PLOTS = {
    "zones": {
        "category": "Geometry",
        "input": {"mesh": f"{R}/geometry/mesh.vtu"},
        "params": OF_PARAMETERS,
    },
    "mesh": {
        "category": "Geometry",
        "input": {"mesh": f"{R}/geometry/mesh.vtu"},
    },
    "strain_field": {
        "category": "Geometry",
        "input": {
            "vtu": f"{R}/mechanics/strains.vtu",
            "strains": f"{R}/mechanics/strains.parquet",
        },
        "params": OF_PARAMETERS | {"strain_exponent": config["observables"]["strain_exponent"]},
    },
    "design": {
        "category": "Simulations",
        "input": {
            "simulations": f"{R}/screening/train.parquet",
            "excluded": f"{R}/screening/train_excluded.csv",
        },
        "params": OF_PARAMETERS | {"channels": OUTPUTS},
    },
    "explained_variance": {
        "category": "Emulator",
        "input": {"explained": f"{R}/reduction/explained_variance.csv"},
        "params": {"threshold": config["reduction"]["explained_variance"]},
    },
    "parity": {
        "category": "Emulator",
        "input": {
            "predictions": f"{R}/emulators/{EMULATOR}/test_predictions.parquet",
            "choice": CHOICE,
        },
        "params": OF_PARAMETERS,
    },
    "per_sample_mse": {
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
        "category": "Emulator",
        "input": {"curves": expand(f"{R}/efficiency/{{curve}}.csv", curve=EFFICIENCY_CURVES)},
    },
    "recovery": {
        "category": "Test set",
        "input": {
            "recovery": f"{POSTERIORS}/test/recovery.csv",
            "coverage": f"{POSTERIORS}/test/coverage.csv",
            "diagnostics": f"{POSTERIORS}/test/diagnostics.csv",
            "choice": CHOICE,
        },
        "params": OF_PARAMETERS,
    },
    "uncertainty": {
        "category": "Test set",
        "input": {
            "coverages": lambda wildcards: of_shortlist("coverage.csv"),
            "errors": lambda wildcards: of_shortlist("map_mse.csv"),
        },
        "params": OF_PARAMETERS,
    },
    "emulator_traces": {
        "category": "Test set",
        "file": "{which}",
        "input": {
            "errors": f"{POSTERIORS}/test/map_mse.csv",
            "posteriors": lambda wildcards: of_shortlist(
                *(f"{batch}.nc" for batch in posterior_batches("test"))
            ),
            "diagnostics": lambda wildcards: of_shortlist("diagnostics.csv"),
        },
        "params": {"shown": lambda wildcards: TRACED[wildcards.which]},
        "wildcards": {"which": any_of(TRACED)},
    },
    "sbc": {
        "category": "Test set",
        "input": {
            "ranks": f"{POSTERIORS}/sbc.csv",
            "tests": f"{POSTERIORS}/sbc_test.csv",
            "choice": CHOICE,
        },
        "params": OF_PARAMETERS,
    },
    "resimulation": {
        "category": "Test set",
        "input": {"resimulated": f"{POSTERIORS}/resimulated.csv"},
    },
    "sampler_agreement": {
        "category": "Test set",
        "input": {"agreement": f"{POSTERIORS}/sampler_agreement.csv"},
        "params": OF_PARAMETERS,
    },
    "bullseye_map": {
        "category": "Scenarios",
        "file": "bullseye_{which}{noise}",
        "input": {
            "recoveries": lambda wildcards: expand(
                f"{POSTERIORS}/{{name}}{wildcards.noise}/recovery.csv",
                name=BULLSEYES[wildcards.which][0],
            )
        },
        "params": OF_PARAMETERS
        | {
            "labels": lambda wildcards: [SCENARIO_LABELS[n] for n in BULLSEYES[wildcards.which][0]],
            "zones": lambda wildcards: BULLSEYES[wildcards.which][1],
            "title": lambda wildcards: BULLSEYES[wildcards.which][2]
            + NOISE_TITLES[wildcards.noise],
        },
        "wildcards": {"which": any_of(BULLSEYES), "noise": any_of(NOISE_TITLES)},
    },
    "map_errors": {
        "category": "Scenarios",
        "input": {
            "recoveries": expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=SCENARIOS),
            "noisy": expand(f"{POSTERIORS}/{{name}}-noisy/recovery.csv", name=SCENARIOS),
        },
        "params": OF_PARAMETERS | {"labels": LABELS},
    },
    "hpd_widths": {
        "category": "Scenarios",
        "input": {
            "recoveries": expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=SCENARIOS),
            "noisy": expand(f"{POSTERIORS}/{{name}}-noisy/recovery.csv", name=SCENARIOS),
        },
        "params": OF_PARAMETERS | {"labels": LABELS},
    },
    "zone_correlations": {
        "category": "Scenarios",
        "file": "zone_correlations{noise}",
        "input": {
            "correlations": expand(
                f"{POSTERIORS}/{{name}}{{{{noise}}}}/zone_correlations.csv", name=SCENARIOS
            ),
            "recoveries": expand(
                f"{POSTERIORS}/{{name}}{{{{noise}}}}/recovery.csv", name=SCENARIOS
            ),
        },
        "params": OF_PARAMETERS
        | {
            "labels": LABELS,
            "title": lambda wildcards: (
                f"Posterior correlations of zones{NOISE_TITLES[wildcards.noise]}: "
                "mean ± standard error"
            ),
        },
        "wildcards": {"noise": any_of(NOISE_TITLES)},
    },
    "correlations": {
        "category": "Scenarios",
        "file": "correlations/{name}{noise}",
        "input": {
            "correlations": f"{POSTERIORS}/{{name}}{{noise}}/correlations.csv",
            "recovery": f"{POSTERIORS}/{{name}}{{noise}}/recovery.csv",
        },
        "params": OF_PARAMETERS
        | {
            "label": lambda wildcards: SCENARIO_LABELS[wildcards.name]
            + NOISE_TITLES[wildcards.noise]
        },
        "wildcards": {"name": any_of(SCENARIOS), "noise": any_of(NOISE_TITLES)},
    },
    "roc": {
        "category": "Scenarios",
        "input": {
            "curves": expand(f"{POSTERIORS}/{{name}}/roc.csv", name=[*SCENARIOS, *NOISY]),
            "areas": expand(f"{POSTERIORS}/{{name}}/auc.csv", name=[*SCENARIOS, *NOISY]),
            "recoveries": expand(f"{POSTERIORS}/{{name}}/recovery.csv", name=[*SCENARIOS, *NOISY]),
        },
        "params": OF_PARAMETERS | {"labels": LABELS},
    },
    "measured_strains": {
        "category": "Subjects",
        "file": "{subject}/measured_strains",
        "input": {"measured": f"{R}/measured/{{subject}}.csv"},
        "params": SOURCE_OF | OF_PARAMETERS,
    },
    "bullseye_posterior": {
        "category": "Subjects",
        "file": "{subject}/bullseye_posterior",
        "input": ANSWER | TRUTH,
        "params": SOURCE_OF | OF_PARAMETERS,
    },
    "posterior_predictive": {
        "category": "Subjects",
        "file": "{subject}/posterior_predictive",
        "input": ANSWER,
        "params": SOURCE_OF,
    },
    "traces": {
        "category": "Subjects",
        "file": "{subject}/traces",
        "input": SUBJECT | TRUTH,
        "params": SOURCE_OF,
    },
    "noise_prior": {
        "category": "Subjects",
        "file": "{subject}/noise_prior",
        "input": {"noise_prior": f"{POSTERIORS}/subjects/{{subject}}_noise_prior.csv"},
        "params": SOURCE_OF | OF_PARAMETERS,
    },
}

# The same of the model as it is, by the emulator of the stiffness alone: the paper's figures.
AS_IT_IS = ["bullseye_posterior", "posterior_predictive"] if ALONE and DOUBTS else []
for name in AS_IT_IS:
    PLOTS[f"{name}_as_it_is"] = PLOTS[name] | {
        "file": f"{{subject}}/{name}_as_it_is",
        "input": SUBJECT | TRUTH if name == "bullseye_posterior" else SUBJECT,
        "of": name,
    }

for name, plot in PLOTS.items():
    file = plot.get("file", name)

    rule:
        name:
            f"plot_{name}"
        input:
            **plot["input"],
        output:
            png=report(
                f"{R}/figures/{file}.png",
                caption=f"../report/{plot.get('of', name)}.rst",
                category=plot["category"],
                subcategory="{subject}" if "{subject}" in file else None,
            ),
            csv=f"{R}/figures/{file}.csv",
        log:
            f"{LOGS}/figures/{file}.log",
        wildcard_constraints:
            **plot.get("wildcards", {}),
        localrule: True
        params:
            **plot.get("params", {}),
            call=f"plots.{plot.get('of', name)}:draw",
        script:
            "../scripts/call.py"


EVALUATING_FIGURES = [
    *([] if FROM_TABLES else ["resimulation"]),
    *("parity", *COMPARISON_FIGURES),
    *("recovery", "uncertainty", *TRACED, "sbc", "sampler_agreement"),
    *(
        f"bullseye_{which}{noise}"
        for which, (sets, *_) in BULLSEYES.items()
        for noise in NOISE_TITLES
        if sets
    ),
    *(["roc"] if LOCAL else []),
    *(["map_errors", "hpd_widths"] if SCENARIOS else []),
    *(f"zone_correlations{noise}" for noise in NOISE_TITLES if SCENARIOS),
    *(f"correlations/{name}" for name in [*SCENARIOS, *NOISY]),
    *(f"{subject}/noise_prior" for subject in NOISE_INFERRED),
]
OF_SUBJECTS = ["measured_strains", "bullseye_posterior", "posterior_predictive"]
FIGURES = expand(
    f"{R}/figures/{{name}}.{{ext}}",
    name=[
        *([] if FROM_TABLES else ["zones", "mesh"]),
        *(["strain_field", "design"] if ALONE and not FROM_TABLES else []),
        *(["explained_variance"] if ALONE else []),
        *(
            f"{subject}/{name}"
            for subject in SUBJECTS
            for name in (
                *OF_SUBJECTS,
                *(f"{name}_as_it_is" for name in AS_IT_IS),
                *(["traces"] if ALONE else []),
            )
        ),
        *(EVALUATING_FIGURES if EVALUATION else []),
    ],
    ext=["png", "csv"],
)
