"""Find the global factors on the reference material."""

import json
from pathlib import Path

from regional_lv.calibration import calibrate
from regional_lv.progress import start_log

start_log(snakemake.log[0])
found = calibrate(snakemake.input.mesh, snakemake.params.physics, snakemake.input.predictor)
Path(snakemake.output[0]).write_text(json.dumps(found, indent=2) + "\n")
