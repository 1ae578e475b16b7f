"""The whole study: includes and targets. Every stage is one file in workflow/rules."""

from snakemake.utils import min_version

min_version("9.0")

if "study" not in config:

    configfile: "config/config.yaml"


report: "workflow/report/workflow.rst"


include: "workflow/rules/common.smk"
include: "workflow/rules/geometry.smk"
include: "workflow/rules/imported_mesh.smk"
include: "workflow/rules/mechanics.smk"
include: "workflow/rules/design.smk"
include: "workflow/rules/simulations.smk"
include: "workflow/rules/verification.smk"
include: "workflow/rules/screening.smk"
include: "workflow/rules/reduction.smk"
include: "workflow/rules/emulators.smk"
include: "workflow/rules/estimates.smk"
include: "workflow/rules/subjects.smk"
include: "workflow/rules/posteriors.smk"
include: "workflow/rules/trust.smk"
include: "workflow/rules/criticism.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/figures_study.smk"
include: "workflow/rules/figures_test_set.smk"
include: "workflow/rules/figures_scenarios.smk"
include: "workflow/rules/figures_subjects.smk"
include: "workflow/rules/paper.smk"
include: "workflow/rules/costs.smk"


rule all:
    """Everything the study shows: figures, tables, what they are made from, and what it took."""
    default_target: True
    input:
        FIGURES,
        TABLES,
        SUMMARIES,
        rules.tabulate_costs.output,
