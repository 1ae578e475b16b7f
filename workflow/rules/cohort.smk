"""Many hearts in one study, answered by the emulator of any heart: many in each job."""

COHORT = LAYOUT.cohort
COHORT_FIGURES = ["stiffness", "pooling", "causes"]

if config["cohort"]["hearts"]:
    try:
        LISTED = {heart.name: heart for heart in list_hearts(config["cohort"]["hearts"])}
    except InputError as error:
        raise WorkflowError(str(error))
    COHORT_BATCHES = batches_of([*LISTED], config["cohort"]["hearts_per_batch"])
    # Beside the code, what any heart is answered by.
    ANY_HEART = tuple(os.path.relpath(path) for path in (ONE_HEART, SHIPPED) if path.is_file())
    ANY_HEART += (DESCRIBED,)
    # What the files of the configuration say themselves: a heart's own comes on top of it.
    OF_COHORT = {
        "shared": {key: value for key, value in gathered.items() if key != "cohort"},
        "folders": [str(folder) for folder in folders],
    }

    checkpoint check_cohort:
        """All hearts are read and compared before one of them is answered. What it writes makes no
        answer again: only a heart's own files do."""
        input:
            lambda wildcards: files_of_hearts(LISTED),
        output:
            checked=COHORT.checked,
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
            lambda wildcards: checked_files_of_hearts(COHORT_BATCHES[wildcards.batch]),
        output:
            folder=directory(COHORT.batch("{batch}").folder),
        log:
            f"{LOGS}/cohort/answer-{{batch}}.log",
        benchmark:
            f"{R}/benchmarks/cohort/answer-{{batch}}.tsv"
        wildcard_constraints:
            batch=any_of(COHORT_BATCHES),
        threads: 1
        resources:
            **needs(mem_mb=3000, minutes=60),
        params:
            **OF_COHORT,
            call="hearts.batches:answer_batch",
            checked=COHORT.checked,
            code=code_of("hearts.batches", files=ANY_HEART),
            hearts=lambda wildcards: fields_of(COHORT_BATCHES[wildcards.batch]),
        script:
            "../scripts/call.py"

    rule summarise_cohort:
        """A row for each heart, the population, and the causes that hearts share."""
        input:
            batches=expand(COHORT.batch("{batch}").folder, batch=COHORT_BATCHES),
            checked=COHORT.checked,
        output:
            table=COHORT.hearts,
            population=COHORT.population,
            causes=COHORT.causes,
        log:
            f"{LOGS}/cohort/summarise.log",
        benchmark:
            f"{R}/benchmarks/cohort/summarise.tsv"
        threads: 1
        resources:
            **needs(mem_mb=4000, minutes=60),
        params:
            call="hearts.summary:summarise_cohort",
            hearts=[*LISTED],
            prevalence_prior=config["cohort"]["prevalence_prior"],
        script:
            "../scripts/call.py"

    rule plot_cohort_stiffness:
        input:
            hearts=COHORT.hearts,
            population=COHORT.population,
        output:
            png=f"{COHORT.folder}/stiffness.png",
            csv=f"{COHORT.folder}/stiffness.csv",
        log:
            f"{LOGS}/cohort/plot_stiffness.log",
        localrule: True
        params:
            call="plots.cohort:draw_stiffness",
        script:
            "../scripts/call.py"

    rule plot_cohort_pooling:
        input:
            hearts=COHORT.hearts,
        output:
            png=f"{COHORT.folder}/pooling.png",
            csv=f"{COHORT.folder}/pooling.csv",
        log:
            f"{LOGS}/cohort/plot_pooling.log",
        localrule: True
        params:
            call="plots.cohort:draw_pooling",
        script:
            "../scripts/call.py"

    rule plot_cohort_causes:
        input:
            causes=COHORT.causes,
        output:
            png=f"{COHORT.folder}/causes.png",
            csv=f"{COHORT.folder}/causes_drawn.csv",
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
            **{f"{name}_picture": f"{COHORT.folder}/{name}.png" for name in COHORT_FIGURES},
            hearts=COHORT.hearts,
            population=COHORT.population,
            causes=COHORT.causes,
            template=given(os.path.relpath(TEMPLATES / "cohort.html")),
        output:
            page=COHORT.page,
        log:
            f"{LOGS}/cohort/page.log",
        localrule: True
        params:
            call="page.cohort:make_cohort_page",
            limitations=limitations_from(COHORT.folder),
        script:
            "../scripts/call.py"


rule cohort:
    """The page and the tables of the study's cohort."""
    input:
        COHORT.page if config["cohort"]["hearts"] else [],
