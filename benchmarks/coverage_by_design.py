"""Coverage of the exact process's intervals when the design is another one, in one run.

    python benchmarks/coverage_by_design.py results/<study> [splits]

The hearts of a scenario lie close together and share the emulator's error there. How many intervals
cover their truth is therefore chance: that of one design, not of a hundred hearts. Here the
training simulations are split into random halves, each half trains an emulator, and the intervals
are those of the Gaussian, or the t, that the emulator's derivatives make of each posterior at the
truth.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from scipy import stats

from regional_lv.emulators import create, load
from regional_lv.emulators.training import read_simulations
from regional_lv.inference.noise import Noise
from regional_lv.paper.sampler.likelihood import Likelihood

CALIBRATIONS = ("variance_factor", "variance_trend", "student")


def scores(emulator, theta: np.ndarray, y: np.ndarray) -> dict[str, float]:
    """Coverage at 50 and 95 %, and the mean squared standardised error, over hearts and factors."""
    at = torch.as_tensor(theta)
    with torch.no_grad():
        prediction = emulator.predict(at)
    slopes = torch.cat([emulator.jacobian(part)[0] for part in at.split(256)]) * at[:, None]
    factor = torch.linalg.cholesky(prediction.covariance)
    error = torch.as_tensor(y) - prediction.mean
    white, error = (
        torch.linalg.solve_triangular(factor, part, upper=False)
        for part in (slopes, error[..., None])
    )
    moved = torch.linalg.solve(white.mT @ white, white.mT @ error)[..., 0]
    # Where errors have a t, a posterior is as wide as those tell that its maximum leaves.
    left = torch.as_tensor(y) - (slopes @ moved[..., None])[..., 0]
    rows = zip(left, at, strict=True)
    likelihoods = [Likelihood(emulator, one, Noise.none(emulator)).near(x) for one, x in rows]
    pairs = zip(likelihoods, at, strict=True)
    covariance = torch.linalg.inv(torch.stack([one.information(x) for one, x in pairs]))
    # A t is wider than the Gaussian with its curvature (`recalibration.interval_factor`).
    n = prediction.freedom + y.shape[1] - theta.shape[1]
    sd = (covariance.diagonal(dim1=-2, dim2=-1) * (1 + theta.shape[1] / n)).sqrt()
    z = (moved / sd).abs().numpy()
    inside = {f"cover{p}": float((z < stats.t.isf((1 - p / 100) / 2, n)).mean()) for p in (50, 95)}
    return inside | {"squared": float((z**2).mean())}


def main(study: Path, splits: int) -> None:
    screened, final = study / "screening", load(study / "emulators" / "final.pt")
    columns = final.parameters, final.outputs
    sets = {
        path.stem: read_simulations(path, *columns)[:2]
        for path in sorted(screened.glob("*.parquet"))
        if path.stem not in ("train", "resimulated")
    }
    theta, y, _ = read_simulations(screened / "train.parquet", *columns)
    rng, rows = np.random.default_rng(0), []
    for split in range(splits):
        for half in np.array_split(rng.permutation(len(theta)), 2):
            for kind in CALIBRATIONS:
                emulator = create("exact_gp", {"calibration": kind})
                emulator.fit(
                    theta[half],
                    y[half],
                    parameters=final.parameters,
                    outputs=final.outputs,
                    seed=split,
                )
                for name, simulated in sets.items():
                    rows.append({"calibration": kind, "set": name} | scores(emulator, *simulated))
        print(f"split {split + 1} of {splits}", file=sys.stderr)
    table = pd.DataFrame(rows).groupby(["calibration", "set"]).agg(["mean", "min", "max"])
    table.columns = [f"{score}_{what}" for score, what in table.columns]
    print(table.round(3).to_csv(), end="")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 4)
