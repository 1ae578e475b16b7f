"""Bad input that reaches the library from files and calls: each error names what and the remedy."""

import numpy as np
import pytest
from scipy.io import savemat

from regional_lv.channels import Channel, Channels
from regional_lv.emulators.reduction import Reduction
from regional_lv.errors import InputError
from regional_lv.geometry.abaqus import read_abaqus
from regional_lv.geometry.segment_tags import read_segment_tags
from regional_lv.geometry.table import check_apices, read_segments
from regional_lv.inputs.stiffness import StiffnessInputs

CHANNELS = Channels.of(["volume", "radial"], {"radial": [1, 2]})
ROWS = np.arange(12.0).reshape(4, 3)

BRICK = """*Node
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
*Element, type={kind}
1, {nodes}
*Surface, type=ELEMENT, name=Endo
inside, S1
"""


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Reduction.fit(ROWS[:, :2], 1.0, CHANNELS), r"shape \(4, 2\); expected \(N, 3\)"),
        (lambda: Reduction.fit(ROWS[:1], 1.0, CHANNELS), "1 rows, 0 of them not finite; give at"),
        (
            lambda: Reduction.fit(ROWS * [1, 0, 1], 1.0, CHANNELS),
            "radial_01 has the same value in every simulation; check the simulator",
        ),
        (lambda: Channels.parse(["radial_01"] * 2), "radial_01 is listed twice; name each once"),
        (lambda: Channels.of(load_fractions=[1.2]), r"loading\.frames: 1\.2 is no load fraction"),
        (lambda: Channels.of(["torsion"], {"torsion": ["top"]}), "'top' is no place of it; there"),
        (lambda: Channel.parse("radial_18"), "radial_18: not the name of a channel; give for inst"),
        (lambda: Channel.parse("radial_07@half"), "radial_07@half: not the name of a channel"),
        (
            lambda: StiffnessInputs(factors=["C_a", "C_a"]),
            r"parameters\.factors: .* names a factor twice or none; name each once",
        ),
    ],
)
def test_of_calls(call, message):
    with pytest.raises(InputError, match=message):
        call()


def written(folder, name, text):
    (folder / name).write_text(text)
    return folder / name


def other_labels(folder):
    savemat(folder / "labels.mat", {"other": {"field": np.arange(3)}})
    return folder / "labels.mat"


NODES = "1, 2, 3, 4, 5, 6, 7, 8"
FILES = {
    "labels that are no MATLAB file": (
        lambda at: read_segment_tags(written(at, "labels.mat", "1,2,3\n" * 99), np.arange(3)),
        r"labels\.mat: cannot be read .*Unknown mat file.*, or a CSV instead",
    ),
    "a MATLAB file of something else": (
        lambda at: read_segment_tags(other_labels(at), np.arange(3)),
        r"labels\.mat: holds no \w+; give a CSV of elements instead",
    ),
    "labels that are not there": (
        lambda at: read_segment_tags(at / "none.mat", np.arange(3)),
        r"none\.mat: there is no such file; give geometry\.imported\.segments",
    ),
    "a table without columns": (
        lambda at: read_segment_tags(written(at, "tags.csv", ""), np.arange(3)),
        r"tags\.csv: holds no table; begin it with a line that names the columns",
    ),
    "tetrahedra": (
        lambda at: read_abaqus(
            written(at, "heart.inp", BRICK.format(kind="C3D4", nodes="1, 2, 3, 5"))
        ),
        r"heart\.inp: holds elements of type C3D4; leave eight-node bricks alone",
    ),
    "a surface of a set that is not there": (
        lambda at: read_abaqus(written(at, "heart.inp", BRICK.format(kind="C3D8", nodes=NODES))),
        r"heart\.inp: a \*Surface names the element set inside, which is not there",
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_of_files(tmp_path, name):
    call, message = FILES[name]
    with pytest.raises(InputError, match=message) as error:
        call(tmp_path)
    assert str(tmp_path) in str(error.value)


@pytest.mark.parametrize(
    ("endo", "epi", "message"),
    [
        (-81.2, -74.4, "must lie, in this order, below the apical level of volunteer"),
        (-40.0, -81.2, "must lie, in this order, below the apical level of volunteer"),
        (-71.0, -72.0, r"line 18: segment 17 ends at z = -\d.* not at the apex .*correct one of"),
        # The table ends at -81.2 mm; half a millimetre is what its rounding may cost.
        (-74.4, -80.6, "segment 17 ends at z = -81.2 mm, not at the apex"),
    ],
)
def test_of_apices_that_are_not_the_tables(endo, epi, message):
    with pytest.raises(InputError, match=message):
        check_apices("volunteer", read_segments("volunteer"), endo, epi)
