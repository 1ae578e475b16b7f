"""Figures of the verification: what is drawn is what was computed and what was published."""

import numpy as np
import pandas as pd
import pytest

from regional_lv.data import path as packaged
from regional_lv.plots import convergence, land, style


@pytest.fixture
def paths(tmp_path):
    return tmp_path / "one.png", tmp_path / "one.csv"


@pytest.fixture
def panels(monkeypatch):
    """Axes of the figures that are saved; no picture is written."""
    seen = []

    def keep(fig, table, png, csv):
        seen.extend(fig.axes)
        table.to_csv(csv, index=False)

    monkeypatch.setattr(style, "save", keep)
    return seen


def test_land(tmp_path, paths, panels):
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
    published = pd.read_csv(packaged("land_2015.csv")).set_index("code")
    ours = dict(zip(land.PANELS, [(300, 4.1), (2000, -26.7), (2000, -28.4), (2000, 10750.0)],
                    strict=True))  # fmt: skip
    for ax, (quantity, own) in zip(panels, ours.items(), strict=True):
        known = published[quantity].dropna()
        drawn = [line.get_ydata()[0] for line in ax.lines if tuple(line.get_xdata()) == (0, 1)]
        assert drawn == known.tolist()
        (mine,) = [line for line in ax.lines if len(line.get_xdata()) == 1]
        assert (mine.get_xdata()[0], mine.get_ydata()[0]) == own
        # All are seen, but for the one that would leave no room: that is written.
        low, high = ax.get_ylim()
        near = known.drop(land.FAR, errors="ignore")
        assert low < min(near.min(), own[1]) and max(near.max(), own[1]) < high
        written = [text.get_text() for text in ax.texts]
        far = known.get(land.FAR)
        assert bool(written) == (far is not None and not low < far < high)
        assert not written or written == [f"{land.FAR}: {far:g}"]


def test_convergence(tmp_path, paths, panels):
    """The slope of each line in its logarithmic panel is the order that its legend states."""
    cases = [("tube", "cavity volume", 4.0), ("tube", "stress", 3.0), ("heart", "volume", 2.0)]
    errors = [(b, n, 100, q, 0.1 * n**-order) for b, q, order in cases for n in (1, 2, 3)]
    orders = [(*case, case[-1]) for case in reversed(cases)]
    columns = ["body", "layers", "unknowns", "quantity", "error"]
    pd.DataFrame(errors, columns=columns).to_csv(tmp_path / "errors.csv", index=False)
    columns = ["body", "quantity", "order", "theory"]
    pd.DataFrame(orders, columns=columns).to_csv(tmp_path / "orders.csv", index=False)
    convergence.draw(tmp_path / "errors.csv", tmp_path / "orders.csv", *paths)
    for ax, expected in zip(panels, ([4.0, 3.0], [2.0]), strict=True):
        assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
        curves = [line.get_xydata() for line in ax.lines if len(line.get_xdata()) == 3]
        slopes = [-np.polyfit(*np.log(curve).T, 1)[0] for curve in curves]
        assert slopes == pytest.approx(expected)
        stated = [text.get_text().rsplit(" ", 1)[1] for text in ax.get_legend().get_texts()]
        assert [float(order) for order in stated] == expected
