"""Fetch one of the paper's published files."""

from regional_lv.data.published import fetch_published
from regional_lv.study.progress import start_log

start_log(snakemake.log[0])
# From the config and not from params: where the file was found must not decide whether it is
# fetched again; its content cannot differ.
resources = snakemake.config["resources"]
fetch_published(
    snakemake.wildcards.file,
    resources["published_mirror"],
    resources["download"],
    snakemake.output[0],
)
