"""The paper's published files."""


rule fetch_published:
    """Where a file was found is no parameter: its content cannot differ (checksum). First, so that
    a run without the network says so at once."""
    output:
        LAYOUT.published("{file}"),
    log:
        f"{LOGS}/published/fetch-{{file}}.log",
    wildcard_constraints:
        file="|".join(FILES),
    priority: FIRST
    localrule: True
    script:
        "../scripts/fetch_published.py"
