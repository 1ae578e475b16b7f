"""Many hearts in one study, answered by the emulator of any heart: many in each job."""

COHORT = f"{R}/cohort"
COHORT_FIGURES = ["stiffness", "pooling", "causes"]

if config["cohort"]["hearts"]:
    try:
        LISTED = {heart.name: heart for heart in list_hearts(config["cohort"]["hearts"])}
    except InputError as error:
        raise WorkflowError(str(error))
    COHORT_BATCHES = batches_of([*LISTED], config["cohort"]["hearts_per_batch"])
    # Beside the code, what any heart is answered by.
    ANY_HEART = tuple(os.path.relpath(path) for path in (ONE_HEART, SHIPPED) if path.is_file())
    # What the files of the configuration say themselves: a heart's own comes on top of it.
    OF_COHORT = {
        "shared": {key: value for key, value in gathered.items() if key != "cohort"},
        "folders": [str(folder) for folder in folders],
    }

    rule check_cohort:
        """All hearts are read and compared before one of them is answered."""
        input:
            lambda wildcards: files_of_hearts(LISTED),
        output:
            checked=f"{COHORT}/checked.json",
        log:
            f"{LOGS}/cohort/check.log",
        localrule: True
        params:
            **OF_COHORT,
            call="hearts.cohort:check_cohort",
            code=code_of("hearts.cohort", files=ANY_HEART),
            hearts=[vars(heart) for heart in LISTED.values()],
            model=model_of_hearts(config),
        script:
            "../scripts/call.py"

    rule answer_hearts:
        """Posterior, verdict and page of each heart of a batch; hearts of other batches do not
        matter to it."""
        input:
            ancient(f"{COHORT}/checked.json"),
            lambda wildcards: files_of_hearts(COHORT_BATCHES[wildcards.batch]),
        output:
            folder=directory(f"{COHORT}/hearts/{{batch}}"),
        log:
            f"{LOGS}/cohort/answer-{{batch}}.log",
        benchmark:
            f"{R}/benchmarks/cohort/answer-{{batch}}.tsv"
        wildcard_constraints:
            batch=any_of(COHORT_BATCHES),
        threads: 1
        params:
            **OF_COHORT,
            call="hearts.batches:answer_batch",
            code=code_of("hearts.batches", files=ANY_HEART),
            hearts=lambda wildcards: fields_of(COHORT_BATCHES[wildcards.batch]),
        script:
            "../scripts/call.py"

    rule summarise_cohort:
        """A row for each heart, the population, and the causes that hearts share."""
        input:
            batches=expand(f"{COHORT}/hearts/{{batch}}", batch=COHORT_BATCHES),
            checked=f"{COHORT}/checked.json",
        output:
            table=f"{COHORT}/hearts.parquet",
            population=f"{COHORT}/population.csv",
            causes=f"{COHORT}/causes.csv",
        log:
            f"{LOGS}/cohort/summarise.log",
        benchmark:
            f"{R}/benchmarks/cohort/summarise.tsv"
        threads: 1
        params:
            call="hearts.summary:summarise_cohort",
            hearts=[*LISTED],
            prevalence_prior=config["cohort"]["prevalence_prior"],
        script:
            "../scripts/call.py"

    rule plot_cohort_stiffness:
        input:
            hearts=f"{COHORT}/hearts.parquet",
            population=f"{COHORT}/population.csv",
        output:
            png=f"{COHORT}/stiffness.png",
            csv=f"{COHORT}/stiffness.csv",
        log:
            f"{LOGS}/cohort/plot_stiffness.log",
        localrule: True
        params:
            call="plots.cohort:draw_stiffness",
        script:
            "../scripts/call.py"

    rule plot_cohort_pooling:
        input:
            hearts=f"{COHORT}/hearts.parquet",
        output:
            png=f"{COHORT}/pooling.png",
            csv=f"{COHORT}/pooling.csv",
        log:
            f"{LOGS}/cohort/plot_pooling.log",
        localrule: True
        params:
            call="plots.cohort:draw_pooling",
        script:
            "../scripts/call.py"

    rule plot_cohort_causes:
        input:
            causes=f"{COHORT}/causes.csv",
        output:
            png=f"{COHORT}/causes.png",
            csv=f"{COHORT}/causes_drawn.csv",
        log:
            f"{LOGS}/cohort/plot_causes.log",
        localrule: True
        params:
            call="plots.cohort:draw_causes",
        script:
            "../scripts/call.py"

    rule make_cohort_page:
        """The page of all hearts, with links to theirs."""
        input:
            given(os.path.relpath(TEMPLATES / "base.html")),
            **{f"{name}_picture": f"{COHORT}/{name}.png" for name in COHORT_FIGURES},
            hearts=f"{COHORT}/hearts.parquet",
            population=f"{COHORT}/population.csv",
            causes=f"{COHORT}/causes.csv",
            template=given(os.path.relpath(TEMPLATES / "cohort.html")),
        output:
            page=f"{COHORT}/page.html",
        log:
            f"{LOGS}/cohort/page.log",
        localrule: True
        params:
            call="page.cohort:make_cohort_page",
            limitations=limitations_from(COHORT),
        script:
            "../scripts/call.py"


rule cohort:
    """The page and the tables of the study's cohort."""
    input:
        f"{COHORT}/page.html" if config["cohort"]["hearts"] else [],
