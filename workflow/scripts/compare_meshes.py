"""Errors of the mesh study's meshes against its reference, which comes last."""

import pandas as pd

from regional_lv.progress import start_log
from regional_lv.verification.mesh_study import compare, summary

start_log(snakemake.log[0])
names = snakemake.params.meshes
tables = [pd.read_parquet(path) for path in snakemake.input.tables]
errors = compare(dict(zip(names, tables, strict=True)), reference=names[-1])
errors.to_csv(snakemake.output.errors, index=False)
summary(errors).to_csv(snakemake.output.summary, index=False)
