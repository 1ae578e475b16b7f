"""Compare the verdicts on hidden effects with the truth."""

from regional_lv.criticism.benchmark import score_benchmark
from regional_lv.progress import start_log

start_log(snakemake.log[0])
score_benchmark(
    snakemake.input.verdicts,
    snakemake.input.truth,
    snakemake.input.subjects,
    snakemake.input.emulator,
    snakemake.input.extensions,
    snakemake.output.cases,
    snakemake.output.confusion,
    snakemake.output.summary,
)
