"""Two versions of the code on the same simulations: errors, coverage and cost of every emulator.

    git worktree add ../before 7833712
    snakemake --cores 2 --configfile config/paper_1500.yaml -- \
        results/paper_1500/screening/{train,test}.parquet
    python benchmarks/emulators_before_after.py config/paper_1500.yaml \
        results/paper_1500/screening/{train,test}.parquet results/before_after \
        --before ../before/src

7833712 is the last commit whose emulators and samplers are all the project's own. Each version runs
in processes of its own, with its own default settings and its own sampler; the functions called
here have the same names and arguments in both. The two take turns, so that what else the machine
does burdens both alike. A result that is there already is not made again.

Writes `rows.csv` into the folder, a row per emulator and version (means over the seeds), and prints
it. output_rmse: in training sd. parameter_mse: of the covariance-weighted estimates, the MAP under
the uniform prior. squared_error_change, mse_change: of output_rmse squared and of parameter_mse,
after over before, with a 95 % bootstrap interval over the test cases, which are the same in both.
coverage95: of the parameters in the posteriors of the first cases, with an interval that knows that
parameters of a case go together; failed: posteriors that do not pass the convergence check.
posteriors_cpu_s: of a hundred; training a local emulator for each is part of it. estimates_cpu_s:
predictions and estimates of all test cases. Seconds are CPU seconds of the process. lines: of the
emulator's module and of what it imports from `emulators/`.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

VERSIONS = ("before", "after")
LOCAL = "local_"


def measure(arguments: argparse.Namespace, folder: Path) -> None:
    """One emulator with the version of the code on PYTHONPATH: `result.json` and `cases.parquet`
    (`score`) in `folder`."""
    import torch

    from regional_lv import config, emulators
    from regional_lv.channels import Channels
    from regional_lv.emulators import training
    from regional_lv.inputs.stiffness import StiffnessInputs
    from regional_lv.paper.posteriors.files import TABLES
    from regional_lv.paper.posteriors.sets import sample_set_batch
    from regional_lv.paper.posteriors.summaries import summarise_posteriors
    from regional_lv.study import dependencies

    torch.set_num_threads(1)
    study, (name,), (seed,) = config.load(arguments.config), arguments.emulators, arguments.seeds
    file, result = folder / "emulator.pt", {"emulator": name, "seed": seed}

    def timed(what: str, function, *args):
        started = time.process_time()
        returned = function(*args)
        result[f"{what}_cpu_s"] = time.process_time() - started
        return returned

    timed(
        "fit",
        training.train_emulator,
        name,
        study["emulators"][name],
        arguments.train,
        StiffnessInputs.from_config(study),
        Channels.from_config(study),
        seed,
        file,
        folder / "fit.json",
    )
    local = name.startswith(LOCAL)
    emulator = emulators.load(file)
    theta, y, samples = training.read_simulations(
        arguments.test, emulator.parameters, emulator.outputs
    )
    tests = arguments.local_tests if local else len(y)
    theta, y = (torch.as_tensor(part[:tests]) for part in (theta, y))
    cases = timed("estimates", score, emulator, theta, y, study["map"], seed)
    cases.set_index(samples[: len(y)]).to_parquet(folder / "cases.parquet")
    count = arguments.local_cases if local else arguments.cases
    if count:
        posteriors, tables = (
            folder / "posteriors.nc",
            {one: folder / f"{one}.csv" for one in TABLES},
        )
        timed(
            "posteriors",
            sample_set_batch,
            file,
            arguments.test,
            "test",
            0,
            1,
            count,
            None,
            study["test_posteriors"]["sampler"],
            study["nuts"],
            study["map"],
            seed,
            posteriors,
        )
        summarise_posteriors([posteriors], list(tables.values()))
        covered = pd.read_csv(tables["coverage"]).set_index("parameter").loc["all"]
        result |= covered[[c for c in covered.index if c.startswith("coverage95")]].to_dict()
        result |= {"posteriors": int(covered["cases"]), "failed": int(covered["failed"])}
        checks = pd.read_csv(tables["diagnostics"]).drop_duplicates("case")
        result["by_nuts"] = int((checks["sampler"] == "nuts").sum())
        result["posteriors_cpu_s"] *= 100 / result["posteriors"]
    source = Path(emulators.__file__).parents[2]
    files = dependencies.files(source, [f"emulators.{name}"], without={"emulators"})
    own = [Path(one) for one in files if Path(one).parent.name == "emulators"]
    result["lines"] = sum(len(one.read_text().splitlines()) for one in own)
    (folder / "result.json").write_text(json.dumps(result, indent=2) + "\n")


def score(emulator, theta, y, point: dict, seed: int) -> pd.DataFrame:
    """Of test cases (C, P), (C, D): squared_error of the outputs in training sd, mse of the
    covariance-weighted estimate, covered (share of the outputs in their 95 % intervals)."""
    import torch

    from regional_lv.inference.noise import Noise
    from regional_lv.paper.estimates.estimate import localised
    from regional_lv.paper.sampler.likelihood import Likelihood
    from regional_lv.paper.sampler.point import find_map
    from regional_lv.seeds import derive

    seed, done, parts = derive(seed, "map", emulator.name, "test"), 0, []
    for local, observed in localised(emulator, y):
        at = theta[done : done + len(observed)]
        with torch.no_grad():
            predicted = local.predict(at)
        error = predicted.mean - observed
        found = find_map(Likelihood(local, observed, Noise.none(local)), **point, seed=seed)
        columns = {
            "squared_error": (error / emulator.output_sd).square().mean(1),
            "mse": (found.theta - at).square().mean(1),
            "covered": (error.abs() <= stats.norm.isf(0.025) * predicted.sd).double().mean(1),
        }
        parts.append(pd.DataFrame({key: value.numpy() for key, value in columns.items()}))
        done += len(observed)
    return pd.concat(parts, ignore_index=True)


def ratio(before: np.ndarray, after: np.ndarray) -> str:
    """Ratio of the means (C,) of the same cases, after to before, with its 95 % interval."""
    pair = (after, before)
    if np.allclose(*pair, rtol=1e-3):
        return "1"
    interval = stats.bootstrap(
        pair,
        lambda a, b, axis: a.mean(axis) / b.mean(axis),
        paired=True,
        vectorized=True,
        rng=np.random.default_rng(0),
    ).confidence_interval
    return f"{after.mean() / before.mean():.2f} ({interval.low:.2f} to {interval.high:.2f})"


def summarise(folder: Path, names: list[str], seeds: list[int]) -> pd.DataFrame:
    """A row per emulator and version, of the seeds for which both are there."""
    rows = []
    for name in names:
        places = [[folder / f"{name}-{seed}" / v for v in VERSIONS] for seed in seeds]
        places = [pair for pair in places if all((p / "result.json").is_file() for p in pair)]
        if not places:
            continue
        cases = {}
        for version, runs in zip(VERSIONS, zip(*places, strict=True), strict=True):
            results = pd.DataFrame([json.loads((p / "result.json").read_text()) for p in runs])
            every = [pd.read_parquet(p / "cases.parquet") for p in runs]
            # Seeds are averaged case by case: cases, not seeds, are what the interval is over.
            cases[version] = sum(every) / len(every)
            row = {"emulator": name, "version": version, "seeds": len(runs)}
            row["output_rmse"] = cases[version]["squared_error"].mean() ** 0.5
            row["output_coverage95"] = cases[version]["covered"].mean()
            row["parameter_mse"] = cases[version]["mse"].mean()
            row["parameter_mse_median"] = cases[version]["mse"].median()
            rows.append(row | results.drop(columns=["emulator", "seed"]).mean().to_dict())
        for error in ("squared_error", "mse"):
            rows[-1][f"{error}_change"] = ratio(*(cases[v][error].to_numpy() for v in VERSIONS))
    return pd.DataFrame(rows)


def main(arguments: argparse.Namespace) -> None:
    folder = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    sources = {"before": arguments.before, "after": Path(__file__).parents[1] / "src"}
    train = folder / "train.parquet"
    pd.read_parquet(arguments.train).iloc[:: arguments.every].to_parquet(train, index=False)
    options = ["--cases", arguments.cases, "--local-cases", arguments.local_cases]
    options += ["--local-tests", arguments.local_tests]
    for seed in arguments.seeds:
        for name in arguments.emulators:
            for version, source in sources.items():
                place = folder / f"{name}-{seed}" / version
                if (place / "result.json").is_file():
                    continue
                place.mkdir(parents=True, exist_ok=True)
                command = [sys.executable, __file__, arguments.config, train, arguments.test, place]
                command += ["--measure", "--emulators", name, "--seeds", seed, *options]
                one_core = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
                environment = os.environ | one_core | {"PYTHONPATH": str(source)}
                with (place / "log.txt").open("w") as log:
                    done = subprocess.run(
                        [str(part) for part in command], env=environment, stderr=log
                    )
                if done.returncode:
                    print(f"{name}, {version}: failed, see {place / 'log.txt'}", file=sys.stderr)
    table = summarise(folder, arguments.emulators, arguments.seeds)
    table.to_csv(folder / "rows.csv", index=False, float_format="%.5g")
    print(table.to_string(index=False, float_format=lambda number: f"{number:.4g}"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", help="of a study; both versions have to understand it")
    parser.add_argument("train", type=Path, help="screened simulations")
    parser.add_argument("test", type=Path)
    parser.add_argument("folder", type=Path, help="for results")
    parser.add_argument("--before", type=Path, help="`src` of the version to compare with")
    parser.add_argument("--every", type=int, default=1, help="of this many training rows one")
    parser.add_argument("--cases", type=int, default=20, help="posteriors; 0: none")
    parser.add_argument("--local-cases", type=int, default=8, help="posteriors of local emulators")
    parser.add_argument("--local-tests", type=int, default=40, help="test cases of the same")
    parser.add_argument("--seeds", type=int, nargs="+", default=[2026])
    parser.add_argument(
        "--emulators",
        nargs="+",
        default=[
            *("exact_gp", "gradient_gp", "local_gp", "local_mgp", "local_dkgp", "local_dkmgp"),
            *("vgp", "mvgp", "dgp", "dnn"),
        ],
    )
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure:
        measure(given, given.folder)
    else:
        main(given)
