"""Numbers of tables as software, spreadsheets and word processors write them."""

import math

import numpy as np
import pytest

from regional_lv import data
from regional_lv.csv_lines import number_in, read_lines
from regional_lv.errors import InputError
from regional_lv.geometry.segment_tags import read_segment_tags
from regional_lv.geometry.table import read_segments
from regional_lv.measured import read_measured
from regional_lv.measured.curves import read_curves
from regional_lv.typed_tables import Column, read_table

MINUS = "\u2212\u2010\u2011\u2012\u2013\ufe63\uff0d"
SPACES = "\u00a0\u202f\u2009\u2007\u200a\u3000"

NUMBERS = {
    **{f"{minus}11.6": -11.6 for minus in MINUS},
    **{f"1e{minus}3": 1e-3 for minus in MINUS},
    **{f"{space}5{space}": 5.0 for space in SPACES},
    **{f"\u2212{space}5": -5.0 for space in SPACES},
    **{f"\u22121{space}234.5": -1234.5 for space in SPACES},
    "12\u202f345\u202f678": 12345678.0,
    "0.123\u2009456": 0.123456,
    "- 5": -5.0,
    "\uff0b1\uff12\uff0e\uff15": 12.5,
    "012": 12.0,
}
NONE = (
    *("", "-", "\u2212", "\u2014", "8\u201310", "\u22128\u20139", "5\u2212", "1\u00a02", "12 345"),
    *(
        "1\u202f2345",
        "0,4",
        "\u22120,4",
        "1_0",
        "10\u00b2",
        "\u00bd",
        "nan",
        "inf",
        "\u2212inf",
        "x",
    ),
)


@pytest.mark.parametrize(("text", "value"), NUMBERS.items(), ids=ascii)
def test_typography_is_read_as_what_it_is(text, value):
    assert number_in(text) == value


@pytest.mark.parametrize("text", NONE, ids=ascii)
def test_what_is_no_finite_number_is_none(text):
    assert math.isnan(number_in(text))


def typeset(text: str) -> str:
    return text.replace("-", "\u2212").replace(",", ",\u00a0")


def test_every_reader_of_tables_takes_them(tmp_path):
    def written(name, header, *rows):
        (tmp_path / name).write_text("\n".join([header, *map(typeset, rows)]))
        return tmp_path / name

    measured = written(
        "measured.csv",
        "quantity,segment,value,unit,sd,load_fraction",
        "volume,,180,mL,2,1",
        "radial,\uff13,40,%,5,1",
        "circumferential,1,-1.16e1,%,2,1",
    )
    table = read_measured(measured)
    assert table["output"].tolist() == ["volume_ml", "radial_03", "circumferential_01"]
    np.testing.assert_allclose(table["value"], [180, 0.4, -0.116], rtol=1e-12)
    curves = written("curves.csv", "time_ms,radial_01", "0,0", "1\u202f000,20", "1\u202f040,-1.5")
    np.testing.assert_allclose(read_curves(curves, "percent").strains[:, 0], [0, 0.2, -0.015])
    header, *rows = data.path("volunteer_segments.csv").read_text().splitlines()
    own = read_segments(written("segments.csv", header, *rows))
    example = read_segments("volunteer")
    for column in ("wall_thickness_mm", "angle_from_deg", "z_bottom_mm"):
        np.testing.assert_array_equal(own[column], example[column])
    tags = written("tags.csv", "element,aha_segment", "1\u202f234,\uff13")
    assert read_segment_tags(tags, np.array([1234])).tolist() == [3]


def test_columns_hold_what_is_declared(tmp_path):
    path = tmp_path / "table.csv"
    columns = ["name", Column("count", whole=True), Column("sd", "mm", least=0, empty=0.0)]
    path.write_text("# a comment\nname,count,sd\na,2,\nb,3,0.5\n")
    table = read_table(path, columns)
    assert table.index.tolist() == [3, 4] and table["name"].tolist() == ["a", "b"]
    assert table["count"].tolist() == [2, 3] and table["sd"].tolist() == [0.0, 0.5]
    path.write_text("name,count\na,2\n")
    assert list(read_table(path, columns)) == ["name", "count"]
    for cells, complaint in (
        ("a,1.5,", "count is 1.5; give a whole number"),
        ("a,,", "count is empty; give a whole number"),
        ("a,1,-2", "sd is -2; give a number of 0 or more mm, or leave it empty"),
    ):
        path.write_text(f"name,count,sd\n{cells}\n")
        with pytest.raises(InputError, match=f"table.csv, line 2: {complaint}"):
            read_table(path, columns)


def test_a_folder_is_no_table(tmp_path):
    folder = tmp_path / "Anna"
    folder.mkdir()
    with pytest.raises(InputError) as error:
        read_lines(folder)
    assert str(error.value) == f"{folder}: is no file; check the path"


@pytest.mark.parametrize(
    ("column", "spelt", "complaint"),
    [
        ("wall_thickness_mm", "wall_thickness", "no column `wall_thickness_mm`; rename `wall_th"),
        ("endo_radius_mm", "endo_radius_cm", "no column `endo_radius_mm`; rename `endo_radius_cm`"),
        ("wall_thickness_sd_mm", "thickness_sd", "thickness_sd looks like a standard deviation"),
        ("endo_radius_sd_mm", "Radius SD", "Radius SD looks like a standard deviation"),
    ],
)
def test_a_misspelt_column_of_sizes_is_no_other_one(tmp_path, column, spelt, complaint):
    """Neither is a column of standard deviations offered for one of sizes, nor ignored."""
    header, *rows = data.path("volunteer_segments.csv").read_text().splitlines()
    given = f"{header},wall_thickness_sd_mm,endo_radius_sd_mm".replace(column, spelt)
    file = tmp_path / "segments.csv"
    file.write_text("\n".join([given, *(f"{row},1,1" for row in rows)]))
    with pytest.raises(InputError, match=complaint):
        read_segments(file)
