"""The summary of simulated against published rows."""

import pandas as pd
import pytest

from regional_lv.paper.published_rows import NATURAL_ROWS, summarise_published_rows


def test_errors_by_scale_quantity_and_level(tmp_path):
    """Errors that are known: 1 and 2 mL, 0.03 and 0.04 in two strains of one row."""
    lines = [
        # row, output, quantity, level, simulated, published
        (1, "volume_ml", "volume", "", 101.0, 100.0),
        (1, "radial_01", "radial", "basal", 0.23, 0.2),
        (1, "radial_07", "radial", "mid", 0.26, 0.3),
        (NATURAL_ROWS + 1, "volume_ml", "volume", "", 98.0, 100.0),
        (NATURAL_ROWS + 1, "radial_01", "radial", "basal", 0.2, 0.2),
        (NATURAL_ROWS + 1, "radial_07", "radial", "mid", 0.3, 0.3),
        (NATURAL_ROWS + 2, "volume_ml", "volume", "", float("nan"), 100.0),
    ]
    columns = ["row", "output", "quantity", "level", "simulated", "published"]
    pd.DataFrame(lines, columns=columns).to_parquet(tmp_path / "rows.parquet")
    summarise_published_rows(tmp_path / "rows.parquet", tmp_path / "summary.csv")
    table = pd.read_csv(tmp_path / "summary.csv", keep_default_na=False)
    found = table.set_index(["scale", "quantity", "level"])
    volume = found.loc[("all", "volume", "")]
    assert volume["simulations"] == 2
    assert volume["mean_error"] == pytest.approx(-0.5)
    assert volume["rms_error"] == pytest.approx(2.5**0.5)
    natural = found.loc[("natural", "strains", "all")]
    assert natural["rms_error"] == pytest.approx((0.0025 / 2) ** 0.5)
    assert natural["mean_error"] == pytest.approx(-0.005)
    assert found.loc[("natural", "radial", "mid"), "mean_error"] == pytest.approx(-0.04)
    both = found.loc[("all", "strains", "all")]
    assert both["rms_error"] == pytest.approx((0.0025 / 4) ** 0.5)
    assert both["median_rms"] == pytest.approx((0.0025 / 2) ** 0.5 / 2)
    assert found.loc[("log", "strains", "all"), "rms_error"] == pytest.approx(0.0)
