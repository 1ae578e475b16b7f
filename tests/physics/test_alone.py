"""A simulation is a process of its own, whoever started it."""

import os
import subprocess
import sys

STEP = {"SLURM_JOB_ID": "1", "SLURM_JOBID": "1", "SLURM_NODELIST": "node", "SLURM_NTASKS": "1"}
STEP |= {"SLURM_STEP_ID": "0", "SLURM_STEPID": "0", "SLURM_PROCID": "0", "SLURM_LOCALID": "0"}
"""What srun says to the processes that it starts."""


def test_srun_does_not_make_it_a_part_of_an_mpi_job():
    program = "from regional_lv.mechanics import dolfinx_api as api; print(api.__name__)"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": "src"} | STEP,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout + done.stderr
