"""Jobs that make figures, tables and pages: those of one kind share a job, which takes seconds to
start, with what is computed for nothing else."""

# Jobs of the comparison with the paper; their figures are drawn by `paper.plots`.
OF_PAPER = [
    *("comparison", "efficiency", "test_set", "checks", "scenarios"),
    *("subject_as_it_is", "noise_prior", "paper"),
]
# Whether `all` needs what a job makes.
SHOWS = {
    "heart": not FROM_TABLES,
    "strain_field": ALONE and not FROM_TABLES,
    "design": ALONE,
    "subject": True,
    "several": True,
    "subjects": bool(SUBJECTS),
    **dict.fromkeys(OF_PAPER, EVALUATION),
    "scenarios": EVALUATION and bool(SCENARIOS),
}
# Jobs of one subject each.
OF_SUBJECTS = {
    **dict.fromkeys(["subject", "subject_as_it_is"], SUBJECTS),
    "noise_prior": NOISE_INFERRED,
    "several": TOGETHER,
}


# What the jobs make, by kind and name, in this order.
MADE_BY_JOBS = {
    "reduction": {
        "job": "design",
        "call": "emulators.reduction:fit_reduction",
        "input": {"train": LAYOUT.screened("train")},
        "params": {"explained_variance": config["reduction"]["explained_variance"]},
        "output": {"reduction": f"{R}/reduction/reduction.npz", "explained": EXPLAINED},
    },
    "strains": {
        "job": "strain_field",
        "call": "simulation.strain_field:map_strains",
        "input": {"mesh": LAYOUT.heart().mesh, "predictor": LAYOUT.predictor()},
        "output": {
            "vtu": LAYOUT.strain_field("vtu"),
            "table": LAYOUT.strain_field("parquet"),
        },
    },
}
for name, plot in PLOTS.items():
    of, file = plot.get("of", name), f"{R}/figures/{plot.get('file', name)}"
    MADE_BY_JOBS[f"figures/{name}"] = plot | {
        "call": f"{'paper.' if plot['job'] in OF_PAPER else ''}plots.{of}:draw",
        "output": {"png": f"{file}.png", "csv": f"{file}.csv"},
        "reported": {"png": plot.get("caption", of)},
    }
for name, table in TABULATED.items():
    text, file = table.get("text", "tex"), f"{R}/tables/{table.get('file', name)}"
    MADE_BY_JOBS[f"tables/{name}"] = table | {
        "output": {"csv": f"{file}.csv", text: f"{file}.{text}"},
        "reported": {"csv": f"table_{name}"},
    }
for job in ("subject", "several"):
    MADE_BY_JOBS[f"criticism/{job}"] = {
        "job": job,
        "call": "plots.criticism:draw",
        "input": {"findings": LAYOUT.findings("{subject}")},
        "output": {
            **{
                name: LAYOUT.criticism_figure("{subject}", name, "png")
                for name in CRITICISM_FIGURES
            },
            "tables": [
                LAYOUT.criticism_figure("{subject}", name, "csv") for name in CRITICISM_FIGURES
            ],
        },
    }
MADE_BY_JOBS |= OF_PAGES

FIGURES, TABLES = (
    made_by(*(job for job, shows in SHOWS.items() if shows), kind=kind)
    for kind in ("figures/", "tables/")
)

for job in SHOWS:
    together = {name: made for name, made in MADE_BY_JOBS.items() if made["job"] == job}
    if not together:
        continue

    rule:
        name:
            f"show_{job}"
        input:
            [made.get("parts", []) for made in together.values()],
            **{
                f"{name}.{key}": files
                for name, made in together.items()
                for key, files in made.get("input", {}).items()
            },
        output:
            **{
                f"{name}.{key}": of_report(made, key, files)
                for name, made in together.items()
                for key, files in made["output"].items()
            },
        log:
            f"{LOGS}/shown/{'{subject}/' if job in OF_SUBJECTS else ''}{job}.log",
        wildcard_constraints:
            subject=any_of(OF_SUBJECTS.get(job, [])),
        localrule: True
        params:
            **{
                f"{name}.{key}": value
                for name, made in together.items()
                for key, value in made.get("params", {}).items()
            },
            calls={name: made["call"] for name, made in together.items()},
        script:
            "../scripts/call.py"


rule sample_efficiency:
    """How many simulations a Gaussian process needs, with and without their sensitivities."""
    input:
        made_by("efficiency"),


rule compare_emulators:
    """Everything up to the shortlist, without posteriors."""
    input:
        SHORTLIST,
        made_by("comparison", "efficiency"),
