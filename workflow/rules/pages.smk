"""One HTML page for each subject: measurements, stiffness, fit, criticism, what to measure next."""

PAGES = expand(LAYOUT.page("{subject}"), subject=[*SUBJECTS, *TOGETHER])
TEMPLATES = SOURCE / "regional_lv" / "page"
PARTS = [
    given(os.path.relpath(TEMPLATES / f"{part}.html")) for part in ("base", "criticism", "sources")
]
PAGE = {
    "category": "Subjects",
    "parts": PARTS,
    "output": {"page": LAYOUT.page("{subject}")},
    "reported": {"page": "page"},
}
# Made by the jobs of the figures that they show. Without a simulator there is no heart to show.
OF_PAGES = {
    "pages/subject": PAGE
    | {
        "job": "subject",
        "call": "page.page:make_page",
        "input": ANSWER
        | {
            "template": given(os.path.relpath(TEMPLATES / "page.html")),
            "measured": LAYOUT.measured("{subject}"),
            "choice": CHOICE if EVALUATION and FROM_TABLES else [],
            "predictions": LAYOUT.predictions(EMULATOR, "test") if FROM_TABLES else [],
            "mesh": [] if FROM_TABLES else LAYOUT.heart().mesh,
            "zones_picture": [] if FROM_TABLES else LAYOUT.figure("zones", "png"),
        },
        "params": page_of_criticism("subject")
        | SOURCE_OF
        | {
            "emulator": EMULATOR if FROM_TABLES else OF_INPUTS,
            "strains_picture": written("figures/measured_strains.png"),
            "stiffness_picture": written("figures/bullseye_posterior.png"),
            "fit_picture": written("figures/posterior_predictive.png"),
            "scales_with_pressure": not why_not_scaling(PHYSICS),
            "limitations": limitations_from(f"{R}/pages"),
        },
    },
}
OF_PAGES["pages/several"] = PAGE | {
    "job": "several",
    "call": "page.page:make_page_of_several",
    "input": {
        "findings": LAYOUT.findings("{subject}"),
        "template": given(os.path.relpath(TEMPLATES / "several.html")),
    },
    "params": page_of_criticism("several"),
}


rule pages:
    """The page of every subject."""
    input:
        PAGES,
