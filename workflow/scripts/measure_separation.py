"""ROC and AUC of the probabilities of one scenario."""

from regional_lv.inference.told_apart import measure_separation
from regional_lv.progress import start_log

start_log(snakemake.log[0])
measure_separation(
    snakemake.input.told_apart,
    snakemake.input.local,
    snakemake.output.roc,
    snakemake.output.auc,
    snakemake.params.seed,
)
