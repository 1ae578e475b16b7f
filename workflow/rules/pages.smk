"""One HTML page for each subject: measurements, stiffness, fit, criticism, what to measure next."""

PAGE_FIGURES = f"{R}/figures/{{subject}}"
PAGES = expand(LAYOUT.page("{subject}"), subject=[*SUBJECTS, *TOGETHER])
TEMPLATES = SOURCE / "regional_lv" / "page"
PARTS = [
    given(os.path.relpath(TEMPLATES / f"{part}.html")) for part in ("base", "criticism", "sources")
]
PAGE_OF_CRITICISM = (
    {
        f"{name}_picture": LAYOUT.criticism_figure("{subject}", name, "png")
        for name in CRITICISM_FIGURES
    }
    if DOUBTS
    else {}
)


rule pages:
    """The page of every subject."""
    input:
        PAGES,


rule make_page:
    """Without a simulator there is neither a heart nor a criticism to show, and the page says so."""
    input:
        PARTS,
        **ANSWER,
        **PAGE_OF_CRITICISM,
        template=given(os.path.relpath(TEMPLATES / "page.html")),
        measured=LAYOUT.measured("{subject}"),
        choice=CHOICE if EVALUATION and not DOUBTS else [],
        predictions=([] if DOUBTS else LAYOUT.predictions(EMULATOR, "test")),
        strains_picture=f"{PAGE_FIGURES}/measured_strains.png",
        stiffness_picture=f"{PAGE_FIGURES}/bullseye_posterior.png",
        fit_picture=f"{PAGE_FIGURES}/posterior_predictive.png",
        mesh=[] if FROM_TABLES else LAYOUT.heart().mesh,
        zones_picture=[] if FROM_TABLES else LAYOUT.figure("zones", "png"),
    output:
        page=report(
            LAYOUT.page("{subject}"),
            caption="../report/page.rst",
            category="Subjects",
            subcategory="{subject}",
        ),
    log:
        f"{LOGS}/pages/{{subject}}.log",
    wildcard_constraints:
        subject=any_of(SUBJECTS),
    localrule: True
    params:
        call="page.page:make_page",
        study=config["study"],
        emulator=OF_INPUTS if DOUBTS else EMULATOR,
        source=lambda wildcards: SUBJECT_SOURCES[wildcards.subject],
        parameters=PARAMETER_SPEC,
        channels=OUTPUTS,
        pressure_mmhg=config["loading"]["pressure_mmhg"],
        strain_exponent=config["observables"]["strain_exponent"],
        scales_with_pressure=not why_not_scaling(PHYSICS),
        limitations=lambda wildcards: os.path.relpath(
            SOURCE.parent / "LIMITATIONS.md", f"{R}/pages"
        ),
        extended=LAYOUT.extended("{subject}") if DOUBTS else "",
    script:
        "../scripts/call.py"


if DOUBTS:

    rule make_page_of_several:
        """The page of hearts whose causes are searched together."""
        input:
            PARTS,
            **PAGE_OF_CRITICISM,
            findings=LAYOUT.findings("{subject}"),
            template=given(os.path.relpath(TEMPLATES / "several.html")),
        output:
            page=report(
                LAYOUT.page("{subject}"),
                caption="../report/page.rst",
                category="Subjects",
                subcategory="{subject}",
            ),
        log:
            f"{LOGS}/pages/{{subject}}.log",
        wildcard_constraints:
            subject=any_of(TOGETHER),
        localrule: True
        params:
            call="page.page:make_page_of_several",
            extended=LAYOUT.extended("{subject}"),
        script:
            "../scripts/call.py"
