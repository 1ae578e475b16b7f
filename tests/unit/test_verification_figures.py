"""Figures of the verification: they are made and carry their numbers."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread

from regional_lv.data import path as packaged
from regional_lv.plots import convergence, land


@pytest.fixture
def paths(tmp_path):
    return tmp_path / "one.png", tmp_path / "one.csv"


def test_land(tmp_path, paths):
    results = pd.DataFrame(
        {
            "problem": ["beam", "ellipsoid"],
            "mesh": ["5x1x1", "2x6x1"],
            "unknowns": [300, 2000],
            "tip_z_mm": [4.1, np.nan],
            "endo_apex_z_mm": [np.nan, -26.7],
            "epi_apex_z_mm": [np.nan, -28.4],
            "cavity_mm3": [np.nan, 10750.0],
        }
    )
    results.to_csv(tmp_path / "results.csv", index=False)
    land.draw(tmp_path / "results.csv", packaged("land_2015.csv"), *paths)
    table = pd.read_csv(paths[1])
    assert table[table["by"] == "study"]["value"].tolist() == [4.1, -26.7, -28.4, 10750.0]
    assert (table["by"] == "code").sum() == 4 + 5 + 5 + 3
    assert imread(paths[0]).std() > 0.05


def test_convergence(tmp_path, paths):
    cases = [("tube", "cavity volume", 4.0), ("heart", "cavity volume", np.nan)]
    errors = [(b, n, 100, q, n**-3.0) for b, q, _ in cases for n in (1, 2, 3)]
    orders = [(b, q, 3.0, theory) for b, q, theory in cases]
    columns = ["body", "layers", "unknowns", "quantity", "error"]
    pd.DataFrame(errors, columns=columns).to_csv(tmp_path / "errors.csv", index=False)
    columns = ["body", "quantity", "order", "theory"]
    pd.DataFrame(orders, columns=columns).to_csv(tmp_path / "orders.csv", index=False)
    convergence.draw(tmp_path / "errors.csv", tmp_path / "orders.csv", *paths)
    table = pd.read_csv(paths[1])
    assert len(table) == 6
    assert (table["order"] == 3.0).all()
    assert imread(paths[0]).std() > 0.05
