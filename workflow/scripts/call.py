"""Call the library function that the rule names (`params.call`) with its files and values."""

from regional_lv.study.jobs import run

run(snakemake)
