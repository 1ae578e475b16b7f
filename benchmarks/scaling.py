"""What grows with a study: seconds and memory of emulators, and of Snakemake's planning.

    python benchmarks/scaling.py emulators --sizes 500 1000 2000 4000 8000
    python benchmarks/scaling.py planning --subjects 1 10 100 1000
    python benchmarks/scaling.py planning --simulations 1000 10000 100000
    python benchmarks/scaling.py jobs --counts 10 100 1000

Prints CSV. Every measurement is made in a process of its own, on one core.

emulators: training, and the mean with its gradient of 1,000 points, against the number of
simulations. No simulator is run: any number of rows is made from smooth functions of theta. They
serve for the times only. An emulator whose training has exceeded `--limit` CPU seconds, or the
memory, is not tried with more rows. Local emulators train at every prediction; one point of
theirs is measured.

planning: `snakemake --dry-run` of the quick study with so many subjects of the user's own or so
many simulations.

jobs: a workflow of so many jobs that only write an empty file, on two cores, planned and run.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
POINTS = 1000


def rows(size: int, parameters, channels):
    """Theta (N, P) between 0.1 and 5, outputs (N, D), and their derivatives (N, D, P): sines of
    random directions of log theta, with curvature of the order of a ventricle's."""
    import numpy as np
    from scipy.stats import qmc

    unit = qmc.Sobol(len(parameters), seed=1).random(size)
    log = np.log(0.1) + unit * np.log(50)
    directions = np.random.default_rng(2).normal(size=(len(channels), len(parameters))) / 4
    phase = log @ directions.T
    slopes = np.cos(phase)[:, :, None] * directions / np.exp(log)[:, None, :]
    return np.exp(log), np.sin(phase), slopes


def measure(name: str, size: int) -> dict:
    """Seconds and memory of one emulator in this process."""
    import torch

    from regional_lv import config, emulators
    from regional_lv.channels import Channels
    from regional_lv.inputs.stiffness import StiffnessInputs

    torch.set_num_threads(1)
    study = config.load(ROOT / "config/config.yaml")
    parameters, channels = StiffnessInputs.from_config(study), Channels.from_config(study)
    theta, y, slopes = rows(size, parameters, channels)
    emulator = emulators.create(name, study["emulators"][name])
    started = time.process_time()
    emulator.fit(theta, y, slopes, parameters=parameters, outputs=channels.names)
    trained = time.process_time()
    points = 1 if name.startswith("local_") else POINTS
    at = torch.as_tensor(theta[:points] * 1.01).clamp(0.1, 5).requires_grad_(True)
    emulator.predict(at).mean.sum().backward()
    return {
        "training_cpu_s": round(trained - started, 2),
        "cpu_ms_per_point": round(1e3 * (time.process_time() - trained) / points, 3),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }


def of_emulators(arguments: argparse.Namespace) -> Iterator[dict]:
    """A row per emulator and size."""
    for name in arguments.emulators:
        for size in sorted(arguments.sizes):
            done = subprocess.run(
                [sys.executable, __file__, "one", name, str(size)], capture_output=True, text=True
            )
            row = {"emulator": name, "simulations": size}
            if done.returncode:
                last = (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1]
                yield row | {"training_cpu_s": "failed: " + last[:80]}
                break
            measured = json.loads(done.stdout)
            yield row | measured
            if measured["training_cpu_s"] > arguments.limit:
                break


def of_planning(arguments: argparse.Namespace) -> Iterator[dict]:
    """A row per size of the study."""
    measured = ROOT / "src/regional_lv/data/measured_template.csv"
    studies = [(count, None) for count in arguments.subjects]
    studies += [(1, count) for count in arguments.simulations]
    for subjects, simulations in studies:
        content = {
            "subjects": {
                f"heart_{i:05d}": {"source": "file", "measured": str(measured)}
                for i in range(subjects)
            }
        }
        if simulations:
            content["design"] = {"natural": simulations}
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "study.yaml"
            file.write_text(json.dumps({"study": "scaling", **content}))
            before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            done = subprocess.run(
                [
                    *(sys.executable, "-m", "snakemake", "--dry-run", "--quiet", "rules"),
                    *("--configfile", "config/quick.yaml", str(file)),
                ],
                cwd=ROOT,
                capture_output=True,
                text=True,
                check=True,
            )
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        total = next(
            line.split()[-1] for line in done.stdout.splitlines() if line.startswith("total")
        )
        yield {
            "subjects": subjects,
            "simulations": simulations or "quick",
            "jobs": total,
            "cpu_s": round(used.ru_utime - before, 1),
            "peak_mb_so_far": used.ru_maxrss // 1024,
        }


def of_jobs(arguments: argparse.Namespace) -> Iterator[dict]:
    """A row per number of jobs."""
    for count in arguments.counts:
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "Snakefile").write_text(
                f"rule all:\n    input: expand('{{i}}.txt', i=range({count}))\n"
                "rule one:\n    output: '{i}.txt'\n    shell: 'touch {output}'\n"
            )
            started = time.monotonic()
            subprocess.run(
                [sys.executable, "-m", "snakemake", "--cores", "2", "--quiet", "all"],
                cwd=folder,
                capture_output=True,
                check=True,
            )
        yield {"jobs": count, "seconds": round(time.monotonic() - started, 1)}


MEASURES = {"emulators": of_emulators, "planning": of_planning, "jobs": of_jobs}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    what = parser.add_subparsers(dest="what", required=True)
    grown = what.add_parser("emulators")
    grown.add_argument("--sizes", type=int, nargs="+", default=[500, 1000, 2000, 4000, 8000])
    grown.add_argument(
        "--emulators", nargs="+", default=["exact_gp", "gradient_gp", "vgp", "dnn", "local_gp"]
    )
    grown.add_argument("--limit", type=float, default=200, help="CPU seconds")
    planned = what.add_parser("planning")
    planned.add_argument("--subjects", type=int, nargs="*", default=[])
    planned.add_argument("--simulations", type=int, nargs="*", default=[])
    ran = what.add_parser("jobs")
    ran.add_argument("--counts", type=int, nargs="+", default=[10, 100, 1000])
    one = what.add_parser("one")
    one.add_argument("emulator")
    one.add_argument("size", type=int)
    arguments = parser.parse_args()
    if arguments.what == "one":
        print(json.dumps(measure(arguments.emulator, arguments.size)))
        return
    for count, row in enumerate(MEASURES[arguments.what](arguments)):
        if not count:
            print(*row, sep=",")
        print(*row.values(), sep=",", flush=True)


if __name__ == "__main__":
    main()
