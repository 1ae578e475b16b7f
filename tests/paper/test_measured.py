"""Published subjects as measured files: segments by their official numbers, frames, bad files."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured import read_measured, write_measured
from regional_lv.paper.measured import (
    import_published_simulation,
    import_volunteer,
    published_simulation,
    published_volunteer,
)

PARAMETERS, CHANNELS = StiffnessInputs(), Channels.of()


def test_volunteer_gets_official_segment_numbers(tmp_path):
    """Columns of the published row carry their own index, so that their place shows."""
    circumferential = -0.1 - np.arange(1, 17) / 1000
    row = [181.0, *circumferential, *(-circumferential)]
    file = tmp_path / "ACase.csv"
    file.write_text(",".join(map(str, row)) + "\n")
    table = published_volunteer(file).set_index("output")
    assert len(table) == 33
    assert table.loc["volume_ml", "value"] == 181.0
    # Published order: basal inferoseptal (AHA 3) comes first, mid anterior (7) ninth, apical
    # inferior (15) last.
    for segment, place in ((3, 1), (7, 9), (15, 16), (1, 3)):
        value = table.loc[f"circumferential_{segment:02d}", "value"]
        assert value == pytest.approx(-0.1 - place / 1000)
        assert table.loc[f"radial_{segment:02d}", "value"] == pytest.approx(-value)
    assert not [name for name in table.index if name.endswith("17")]


def test_volunteer_of_another_shape_is_refused(tmp_path):
    file = tmp_path / "ACase.csv"
    file.write_text("181.0,-0.1\n")
    with pytest.raises(InputError, match=r"shape \(1, 2\) instead of \(1, 33\); fetch it again"):
        published_volunteer(file)


def volunteer_slices(folder: Path) -> tuple[Path, list[Path]]:
    """A volunteer, and slices n = 1-5 whose strain in frame k and sector j is n + k / 10 + j / 100
    (circumferential: -)."""
    case = folder / "ACase.csv"
    case.write_text(",".join(["180.9", *["-0.15"] * 16, *["0.4"] * 16]))
    slices = []
    for n in range(1, 6):
        rows = [[n + k / 10 + j / 100 for j in range(6)] for k in range(5)]
        lines = [",".join(f"{v}" for v in [*(-value for value in row), *row]) for row in rows]
        slices.append(folder / f"slice{n}.csv")
        slices[-1].write_text("\n".join(["names", *lines]) + "\n")
    return case, slices


def test_volunteer_of_one_frame_is_the_mean_of_the_slices_at_each_level(tmp_path):
    case, slices = volunteer_slices(tmp_path)
    whole = published_volunteer(case, slices, 2)
    assert whole["source"].unique().tolist() == ["published volunteer, frame 2"]
    table = whole.set_index("output")["value"]
    assert len(table) == 33 and table["volume_ml"] == 180.9
    # AHA 1 is the third sector, 8 the second; apical septal (14) joins the first two.
    expected = {1: 1.5 + 0.2 + 0.02, 8: 3.5 + 0.2 + 0.01, 14: 5 + 0.2 + 0.005, 15: 5 + 0.2 + 0.05}
    for segment, strain in expected.items():
        assert table[f"radial_{segment:02d}"] == pytest.approx(strain)
        assert table[f"circumferential_{segment:02d}"] == pytest.approx(-strain)


def test_volunteer_of_chosen_slices_and_of_extrema(tmp_path):
    table = published_volunteer(*volunteer_slices(tmp_path), "extrema", [2, 3, 5])
    values = table.set_index("output")["value"]
    assert values["radial_03"] == pytest.approx(2 + 0.4)
    assert values["circumferential_09"] == pytest.approx(-(3 + 0.4))
    assert table["source"].unique().tolist() == [
        "published volunteer, frame extrema, slices 2, 3, 5"
    ]


def test_frame_that_the_slices_lack(tmp_path):
    for frame in (0, 5):
        with pytest.raises(InputError, match=rf"slice1.csv: no frame {frame}; choose 1 to 4, or e"):
            published_volunteer(*volunteer_slices(tmp_path), frame)


def test_published_simulation_gets_official_segment_numbers(tmp_path):
    """Every published strain carries its own place."""
    outputs = [150.0, *(k / 1000 for k in range(1, 52))]
    (tmp_path / "x.csv").write_text("0," * 9 + "0\n" + ",".join(map(str, range(1, 11))) + "\n")
    (tmp_path / "y.csv").write_text("0," * 51 + "0\n" + ",".join(map(str, outputs)) + "\n")
    table, theta = published_simulation(tmp_path / "x.csv", tmp_path / "y.csv", 2)
    assert theta.to_dict() == dict(zip(PARAMETERS.names, range(1, 11), strict=True))
    values = table.set_index("output")["value"]
    assert tuple(values.index) == CHANNELS.names
    # AHA 3 (basal inferoseptal) is published first, AHA 1 (basal anterior) third.
    assert values["circumferential_03"] == pytest.approx(0.001)
    assert values["radial_01"] == pytest.approx(0.017 + 0.003)
    with pytest.raises(InputError, match="there are 2 rows; choose one of them"):
        published_simulation(tmp_path / "x.csv", tmp_path / "y.csv", 3)


def test_volunteer_survives_a_round_trip(tmp_path):
    file = tmp_path / "ACase.csv"
    file.write_text(",".join(["180.9", *["-0.15"] * 16, *["0.4"] * 16]))
    table = published_volunteer(file)
    write_measured(table, tmp_path / "volunteer.csv")
    pd.testing.assert_frame_equal(read_measured(tmp_path / "volunteer.csv"), table)


def test_published_subjects_are_what_the_study_observes_of_them(tmp_path):
    some = Channels.of(["volume", "radial"], {"radial": [1, 2]})
    case = tmp_path / "ACase.csv"
    case.write_text(",".join(["180.9", *["-0.15"] * 16, *["0.4"] * 16]))
    import_volunteer(case, None, None, some, tmp_path / "volunteer.csv")
    assert tuple(read_measured(tmp_path / "volunteer.csv", some)["output"]) == some.names
    (tmp_path / "x.csv").write_text(",".join(["1"] * 10) + "\n")
    (tmp_path / "y.csv").write_text(
        ",".join(["150", *["-0.1"] * 17, *["0.2"] * 17, *["-0.1"] * 17])
    )
    files = tmp_path / "row.csv", tmp_path / "theta.csv"
    import_published_simulation(tmp_path / "x.csv", tmp_path / "y.csv", 1, "row_1", some, *files)
    assert tuple(read_measured(files[0])["output"]) == some.names
    theta = pd.read_csv(files[1], index_col="subject")
    assert theta.loc["row_1"].tolist() == [1.0] * 10 and tuple(theta) == PARAMETERS.names
