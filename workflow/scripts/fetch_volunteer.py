"""Fetch the published measurements of the healthy volunteer."""

from regional_lv.progress import start_log
from regional_lv.resources import VOLUNTEER, fetch_published

start_log(snakemake.log[0])
# From the config and not from params: where the file was found must not decide whether it is
# fetched again; its content cannot differ.
resources = snakemake.config["resources"]
fetch_published(
    VOLUNTEER, resources["published_mirror"], resources["download"], snakemake.output[0]
)
