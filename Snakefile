"""The whole study; what it consists of is in workflow/Snakefile."""


include: "workflow/Snakefile"


# An included file cannot choose what is made when nothing is named.
workflow.default_target = "cohort" if config["cohort"]["hearts"] else "all"
