"""A toy study: emulator, tables of simulations and measured files."""

import numpy as np
import pandas as pd
import pytest

from regional_lv.channels import Channels
from regional_lv.emulators.exact_gp import ExactGP
from regional_lv.inputs.stiffness import StiffnessInputs

PARAMETERS = StiffnessInputs()
CHANNELS = Channels.of()


def simulate(theta: np.ndarray) -> pd.DataFrame:
    """A table of 52 smooth outputs with the signs and sizes of volume and strains."""
    rng = np.random.default_rng(6)
    x = np.log(theta)
    columns = [150 - 10 * x @ rng.uniform(0.5, 1.0, 10)]
    for level in (-0.15, 0.3, -0.15):
        for _ in range(17):
            weights = rng.uniform(-0.5, 1.0, 10)
            columns.append(level * np.exp(-0.15 * np.tanh(x @ weights) - 0.02 * x @ weights))
    frame = pd.DataFrame(theta, columns=list(PARAMETERS.names))
    frame.insert(0, "sample", np.arange(len(theta)))
    return pd.concat(
        [frame, pd.DataFrame(np.stack(columns, 1), columns=list(CHANNELS.names))], axis=1
    )


@pytest.fixture(scope="session")
def study(tmp_path_factory):
    """Emulator, test table and a measured file of a toy study."""
    folder = tmp_path_factory.mktemp("study")
    rng = np.random.default_rng(7)
    train = np.exp(rng.uniform(np.log(0.1), np.log(5.0), size=(300, 10)))
    table = simulate(train)
    # The toy mixes all parameters alike: no zones.
    emulator = ExactGP(iterations=60, kernel="rq").fit(
        train,
        table[list(CHANNELS.names)].to_numpy(),
        parameters=PARAMETERS,
        outputs=CHANNELS.names,
    )
    emulator.save(folder / "emulator.pt")
    test = simulate(rng.uniform(0.3, 4.0, size=(4, 10)))
    test["sample"] = [3, 5, 8, 9]
    test.to_parquet(folder / "test.parquet")
    rows = ["quantity,segment,value,unit", f"volume,,{test['volume_ml'][0]},mL"]
    for direction in ("circumferential", "radial"):
        for segment in range(1, 17):
            value = test[f"{direction}_{segment:02d}"][0] + rng.normal(0, 0.01)
            rows.append(f"{direction},{segment},{value},1")
    (folder / "subject.csv").write_text("\n".join(rows) + "\n")
    with_sd = [rows[0] + ",sd", rows[1] + ",2.0", *(row + ",0.01" for row in rows[2:])]
    (folder / "with_sd.csv").write_text("\n".join(with_sd) + "\n")
    return folder
