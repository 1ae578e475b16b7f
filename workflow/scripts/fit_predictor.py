"""Fit the predictor of displacement fields to the anchors."""

from regional_lv.mechanics.predictor import Predictor, read_anchors
from regional_lv.progress import start_log

start_log(snakemake.log[0])
Predictor.fit(*read_anchors(snakemake.input.anchors)).save(snakemake.output[0])
