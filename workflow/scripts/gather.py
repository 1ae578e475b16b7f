"""Put batches of one table together."""

import pandas as pd

from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = pd.concat([pd.read_parquet(batch) for batch in snakemake.input], ignore_index=True)
table.to_parquet(snakemake.output[0], index=False)
