"""Draw what a criticism found and write its page."""

from pathlib import Path

from regional_lv.criticism.report import write_report
from regional_lv.progress import start_log

start_log(snakemake.log[0])
write_report(
    snakemake.input.findings, snakemake.output.page, Path(snakemake.output.residuals).parent
)
