"""Check a measured file and write it in the units of the project."""

from regional_lv.measured import read_measured, write_measured
from regional_lv.progress import start_log

start_log(snakemake.log[0])
write_measured(read_measured(snakemake.input.measured), snakemake.output[0])
