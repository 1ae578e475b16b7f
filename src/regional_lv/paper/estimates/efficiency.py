"""How many simulations an emulator needs: its errors on subsets of the training set."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv import emulators
from regional_lv.channels import Channels
from regional_lv.emulators.gaussian import Z95
from regional_lv.emulators.training import read_sensitivities, read_simulations
from regional_lv.inference.noise import Noise
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.point import find_map
from regional_lv.seeds import derive
from regional_lv.study.progress import Progress


def measure_efficiency(
    emulator: str,
    transform: str,
    settings: dict,
    parameters: StiffnessInputs,
    channels: Channels,
    train: str | Path,
    test: str | Path,
    sizes: Sequence[int],
    most_with_sensitivities: int,
    point: dict,
    seed: int,
    curve: str | Path,
) -> None:
    """Fit an emulator to more and more simulations of a screened table; write its errors (CSV).

    emulator: its name; transform: of its inputs, whatever `settings` say. Subsets are nested, in
    one random order that all emulators share. sizes: those that there are not are left out, and the
    whole table is added; an emulator that learns from sensitivities ends at
    `most_with_sensitivities`. point: section `map` of the config.

    Columns: emulator, input_transform, simulations, predictive_mse (all outputs of the test set, in
    squared training sd of the whole table), predictive_coverage95, param_mse (weighted estimates),
    training_seconds.
    """
    columns, settings = (parameters, channels.names), settings | {"input_transform": transform}
    theta, y, _ = read_simulations(train, *columns)
    at, truth, _ = read_simulations(test, *columns)
    learns = emulators.REGISTRY[emulator].learns_from_sensitivities
    slopes = read_sensitivities(train, *columns) if learns else None
    order = np.random.default_rng(derive(seed, "efficiency")).permutation(len(theta))
    most = min(len(theta), most_with_sensitivities) if learns else len(theta)
    sizes = sorted({size for size in sizes if size < most} | {most})
    scale, rows = torch.as_tensor(y.std(axis=0, ddof=1)), []
    progress = Progress(f"{emulator}: sample efficiency", len(sizes))
    for size in sizes:
        chosen = order[:size]
        fitted = emulators.create(emulator, settings)
        fitted.fit(
            theta[chosen],
            y[chosen],
            None if slopes is None else slopes[chosen],
            parameters=parameters,
            outputs=channels.names,
            seed=derive(seed, "efficiency", emulator, size),
        )
        with torch.no_grad():
            prediction = fitted.predict(torch.as_tensor(at))
        error = prediction.mean - torch.as_tensor(truth)
        likelihood = Likelihood(fitted, torch.as_tensor(truth), Noise.none(fitted))
        found = find_map(likelihood, **point, seed=derive(seed, "efficiency", "map"))
        rows.append(
            {
                "emulator": emulator,
                "input_transform": transform,
                "simulations": size,
                "predictive_mse": float((error / scale).square().mean()),
                "predictive_coverage95": float(
                    (error.abs() <= Z95 * prediction.sd).double().mean()
                ),
                "param_mse": float(np.square(found.theta.numpy() - at).mean()),
                "training_seconds": fitted.info["seconds"],
            }
        )
        progress.step()
    pd.DataFrame(rows).to_csv(curve, index=False)
