"""What the input transform does to the estimates of every emulator."""

from pathlib import Path

from regional_lv.estimates.transforms import compare_transforms
from regional_lv.progress import start_log

start_log(snakemake.log[0])
compare_transforms(
    snakemake.params.transforms,
    Path(snakemake.input.estimates[0]).parents[1],
    Path(snakemake.input.predictions[0]).parents[1],
    snakemake.input.train,
    snakemake.input.paper,
    snakemake.output[0],
)
