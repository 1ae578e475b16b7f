"""The paper's published files."""


rule fetch_published:
    """Where a file was found is no parameter: its content cannot differ (checksum)."""
    output:
        LAYOUT.published("{file}"),
    log:
        f"{LOGS}/published/fetch-{{file}}.log",
    wildcard_constraints:
        file="|".join(FILES),
    localrule: True
    script:
        "../scripts/fetch_published.py"
