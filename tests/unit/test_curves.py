"""Strain curves: known deformations, both references, the choice of the frame, and bad input."""

import numpy as np
import pandas as pd
import pytest

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured import import_curves, read_curve_subject, read_measured
from regional_lv.measured.curves import Unloading, spikes

FRAMES = 20
END_SYSTOLE = 7
CONTRACTION = np.array(
    [
        *(0, 0.1, 0.3, 0.55, 0.8, 0.92, 0.98, 1, 0.97, 0.95),
        *(0.7, 0.45, 0.3, 0.25, 0.2, 0.15, 0.1, 0.04, 0.02, 0.01),
    ]
)
"""Share of the greatest contraction by frame: end diastole, systole, isovolumic, filling."""
FIRST_FILLING = 10

DIRECTIONS = ("circumferential", "radial", "longitudinal")
AXES = {"circumferential": (0.8, 0.6, 0.0), "radial": (-0.6, 0.8, 0.0), "longitudinal": (0, 0, 1)}


def deformation(share: float) -> np.ndarray:
    """Volume-preserving F (3, 3) from end diastole to a contracted frame, with shear."""
    shear = np.array([[1, 0, 0.2 * share], [0, 1, 0], [0.1 * share, 0, 1]])
    turned = np.column_stack(list(AXES.values()))
    stretches = np.diag([1 - 0.2 * share, 1 / ((1 - 0.2 * share) * (1 - 0.15 * share)), 1])
    stretches[2, 2] -= 0.15 * share
    return shear @ turned @ stretches @ turned.T


STRETCHES = np.array(
    [
        [np.linalg.norm(deformation(share) @ np.array(axis)) for axis in AXES.values()]
        for share in CONTRACTION
    ]
)
"""Length of the lines along the axes over that at end diastole, (frames, 3)."""


@pytest.fixture
def write(tmp_path):
    """Write curves of two segments; `change` edits the table before."""

    def write(reference=0, measure="engineering", unit="percent", clock="frame", change=None):
        stretches = STRETCHES / STRETCHES[reference]
        strains = stretches - 1 if measure == "engineering" else (stretches**2 - 1) / 2
        scale = 100 if unit == "percent" else 1
        table = pd.DataFrame({clock: np.arange(FRAMES) + 1})
        for segment in (3, 16):
            for k, direction in enumerate(DIRECTIONS):
                table[f"{direction}_{segment:02d}"] = scale * strains[:, k]
        table = table if change is None else change(table)
        table.to_csv(tmp_path / "curves.csv", index=False)
        return {
            "curves": str(tmp_path / "curves.csv"),
            "unit": unit,
            "measure": measure,
            "reference": "end_diastole" if reference == 0 else "end_systole",
            "frame": FIRST_FILLING + 1,
            "end_diastole_frame": None,
            "volume_ml": 180.0,
            "sd": {"strain": 0.02, "volume": None},
        }

    return write


def looking_back() -> np.ndarray:
    """(F^-T F^-1 - I) / 2 of the way from the unloaded frame to end diastole, along the axes."""
    F = np.linalg.inv(deformation(CONTRACTION[FIRST_FILLING]))
    inverse = np.linalg.inv(F)
    E = (inverse.T @ inverse - np.eye(3)) / 2
    return np.array([axis @ E @ axis for axis in map(np.array, AXES.values())])


@pytest.mark.parametrize("unit", ["percent", "fraction"])
@pytest.mark.parametrize("measure", ["engineering", "green"])
@pytest.mark.parametrize("reference", [0, END_SYSTOLE])
def test_known_deformation_gives_its_strain_whatever_the_export(write, reference, measure, unit):
    table = read_curve_subject(write(reference, measure, unit)).table
    assert table["output"].tolist() == [
        "volume_ml",
        *(f"{direction}_{segment}" for segment in ("03", "16") for direction in DIRECTIONS),
    ]
    np.testing.assert_allclose(table["value"][1:], np.tile(looking_back(), 2), rtol=1e-9)
    assert table["value"][0] == 180 and np.isnan(table["sd"][0])
    assert (table["sd"][1:] == 0.02).all()


@pytest.mark.parametrize("exponent", [1.0, 0.0, -2.0])
def test_other_strain_measures_are_of_the_same_stretch(write, exponent):
    value = read_curve_subject(write(), strain_exponent=exponent).table["value"][1:4].to_numpy()
    stretch = np.sqrt(1 + 2 * looking_back())
    expected = (stretch**exponent - 1) / exponent if exponent else np.log(stretch)
    np.testing.assert_allclose(value, expected, rtol=1e-9)


@pytest.mark.parametrize("reference", [0, END_SYSTOLE])
def test_earliest_diastole_is_the_first_frame_that_fills(write, reference):
    chosen = read_curve_subject(write(reference)).table
    found = read_curve_subject(write(reference) | {"frame": "earliest_diastole"}).table
    pd.testing.assert_frame_equal(found, chosen)
    assert chosen["source"][1] == "curves.csv, frame 11"


@pytest.mark.parametrize(
    ("unloaded", "doubt"), [(5, "is no later than"), (8, "relaxation may not be"), (12, "")]
)
def test_a_frame_of_a_muscle_at_work_is_doubted(unloaded, doubt):
    share = CONTRACTION[unloaded]
    back = Unloading(STRETCHES[unloaded], unloaded, 0, END_SYSTOLE, share)
    found = back.doubts(range(FRAMES))
    assert bool(found) == bool(doubt) and doubt in " ".join(found)


def test_a_spike_is_named(write):
    """It moves the frame that is taken as unloaded."""

    def with_noise(table):
        noise = np.random.default_rng(1).normal(0, 0.5, (FRAMES, 3))
        noise[0] = 0
        names = ("circumferential_08", "circumferential_09", "radial_09")
        more = {name: table[f"{name[:-3]}_03"] for name in names}
        return table.assign(**(pd.DataFrame(more) + noise))

    def with_a_spike(table):
        table = with_noise(table)
        table.loc[FIRST_FILLING, "circumferential_09"] = -50
        return table

    smooth, spiky = (
        read_curve_subject(write(change=change) | {"frame": "earliest_diastole"})
        for change in (with_noise, with_a_spike)
    )
    assert smooth.unloading.unloaded == FIRST_FILLING and spikes(smooth.curves) == []
    assert spiky.unloading.unloaded == FIRST_FILLING + 1
    (line,) = spikes(spiky.curves)
    assert line.startswith("circumferential_09 is -50.0 % in frame 11, and ")
    assert " by the frames beside it; correct the value, or remove the column" in line


def test_frames_are_counted_where_only_times_are_given(write):
    by_time, by_frame = (read_curve_subject(write(clock=c)).table for c in ("time_ms", "frame"))
    np.testing.assert_array_equal(by_time["value"], by_frame["value"])


def test_numbers_of_frames_count_wherever_their_column_stands(write):
    def change(table):
        table.insert(0, "time_ms", 30.0 * table["frame"])
        return table.assign(frame=table["frame"] - 1)

    table = read_curve_subject(write(change=change) | {"frame": FIRST_FILLING}).table
    np.testing.assert_allclose(table["value"][1:], np.tile(looking_back(), 2), rtol=1e-9)


def beginning_at(first: int, keep=slice(None), beats: int = 1):
    """A file that begins with the frame `first` (from 0) of the cycle, of so many beats, of which
    it holds the rows `keep`."""

    def change(table):
        rolled = pd.concat([table[first:], table[:first]] * beats, ignore_index=True)
        return rolled.assign(frame=range(1, len(rolled) + 1))[keep]

    return change


@pytest.mark.parametrize("first", range(FRAMES))
@pytest.mark.parametrize("reference", [0, END_SYSTOLE])
def test_cycle_that_begins_with_any_frame(write, reference, first):
    """Filling may wrap around the end of the file; the frames are those of the cycle."""
    end_diastole, filling = -first % FRAMES, (FIRST_FILLING - first) % FRAMES
    subject = write(reference, change=beginning_at(first))
    subject["frame"] = "earliest_diastole"
    subject["end_diastole_frame"] = end_diastole + 1
    curves, back, table = read_curve_subject(subject)
    np.testing.assert_allclose(table["value"][1:4], looking_back(), rtol=1e-9)
    assert (back.unloaded, back.end_diastole) == (filling, end_diastole)
    assert back.doubts(curves.frames) == []
    # The same frame by its number, and end diastole where all curves are zero.
    subject["frame"] = filling + 1
    subject["end_diastole_frame"] = None if reference == 0 else end_diastole + 1
    curves, again, named = read_curve_subject(subject)
    pd.testing.assert_frame_equal(named, table)
    assert again.end_diastole == end_diastole and again.doubts(curves.frames) == []
    # A frame in which the muscle is at work is doubted wherever the file begins.
    subject["frame"] = (END_SYSTOLE - 2 - first) % FRAMES + 1
    curves, back, _ = read_curve_subject(subject)
    (doubt,) = back.doubts(curves.frames)
    assert "is no later than the greatest contraction" in doubt


@pytest.mark.parametrize("first", [1, 5, FRAMES - 3])
def test_numbers_of_frames_may_go_around(write, first):
    """Rows from end diastole on, with the numbers that the frames have in the cine."""
    numbers = np.roll(np.arange(1, FRAMES + 1), -first)
    subject = write(change=lambda table: table.assign(frame=numbers))
    chosen, found = (
        read_curve_subject(subject | {"frame": frame})
        for frame in (int(numbers[FIRST_FILLING]), "earliest_diastole")
    )
    pd.testing.assert_frame_equal(chosen.table, found.table)
    np.testing.assert_allclose(found.table["value"][1:4], looking_back(), rtol=1e-9)
    with pytest.raises(InputError, match="does not follow"):
        read_curve_subject(write(change=lambda t: t.assign(time=numbers).drop(columns="frame")))


@pytest.mark.parametrize(
    ("change", "end_diastole", "unloaded"),
    [
        # Late diastole is missing, at the end of the file or before it.
        (beginning_at(0, slice(0, 12)), 1, 11),
        (beginning_at(FRAMES - 2, slice(0, 14)), 3, 13),
        # So is a part of systole.
        (beginning_at(8, slice(0, 18)), 13, 3),
        # The first frames are the systole of the beat before.
        (beginning_at(3, slice(0, 26), beats=2), 18, 8),
        (beginning_at(5, slice(0, 25), beats=2), 16, 6),
    ],
)
def test_a_part_of_the_cycle_is_enough_where_the_ventricle_begins_to_fill(
    write, change, end_diastole, unloaded
):
    subject = write(change=change)
    subject |= {"frame": "earliest_diastole", "end_diastole_frame": end_diastole}
    curves, back, table = read_curve_subject(subject)
    assert curves.frames[back.unloaded] == unloaded and back.doubts(curves.frames) == []
    np.testing.assert_allclose(table["value"][1:4], looking_back(), rtol=1e-9)


def test_a_ventricle_that_is_larger_than_at_end_diastole_is_doubted(write):
    """Curves of end systole do not say where end diastole is."""
    subject = write(END_SYSTOLE, change=beginning_at(13)) | {"frame": "earliest_diastole"}
    curves, back, _ = read_curve_subject(subject)
    (doubt,) = back.doubts(curves.frames)
    assert doubt.startswith("in frame 8 the ventricle is larger than in frame 1, taken as end dias")


@pytest.mark.parametrize("reference", [0, END_SYSTOLE])
def test_six_apical_walls_become_the_four_segments_of_the_aha(write, reference):
    """Each has the mean stretch of the walls in its sector, whatever the reference."""
    walls = {13: 0.0, 14: 0.3, 15: 0.6, 16: 0.9, 17: 0.5, 18: 0.2}

    def six_walls(table):
        # Walls that are at end systole later or earlier shorten more or less.
        for wall, more in walls.items():
            length = (1 + table["circumferential_03"] / 100) ** (1 + more)
            table[f"circumferential_{wall}"] = 100 * (length - 1)
        return table.drop(columns=[c for c in table if c.endswith("_16") and "circ" not in c])

    subject = write(reference, change=six_walls) | {"segments": 18}
    table = read_curve_subject(subject, strain_exponent=1.0).table.set_index("output")
    names = [f"circumferential_{segment}" for segment in (13, 14, 15, 16)]
    assert {n for n in table.index if "circ" in n} == {"circumferential_03", *names}
    single = STRETCHES[FIRST_FILLING, 0]
    l13, l14, l15, l16, l17, l18 = (single ** (1 + more) for more in walls.values())
    expected = [
        (4 * l13 + l14 + l18) / 6,
        (l14 + l15) / 2,
        (4 * l16 + l15 + l17) / 6,
        (l17 + l18) / 2,
    ]
    np.testing.assert_allclose(table.loc[names, "value"], np.array(expected) - 1, rtol=1e-9)
    np.testing.assert_allclose(table.loc[names, "sd"], 0.02 / np.sqrt(2), rtol=1e-12)
    assert table.loc["circumferential_03", "sd"] == 0.02


def test_names_of_columns_may_be_written_in_other_ways_and_comments_are_allowed(write):
    subject = write()
    with open(subject["curves"]) as file:
        text = file.read()
    with open(subject["curves"], "w") as file:
        file.write("# of a made-up heart\n" + text.replace("radial_03", "Radial 3"))
    assert "radial_03" in read_curve_subject(subject).table["output"].tolist()


@pytest.mark.filterwarnings("ignore::regional_lv.measured.MeasuredWarning")
def test_measured_file_of_curves_is_read_like_any_other(write, tmp_path):
    subject, channels = write(), Channels.of()
    import_curves(
        subject["curves"], subject, channels, 2.0, StiffnessInputs(), tmp_path / "measured.csv"
    )
    table = read_measured(tmp_path / "measured.csv", channels, 8.0)
    np.testing.assert_allclose(table["value"][1:4], looking_back(), rtol=1e-9)


def setting(column, value, rows=slice(None)):
    def change(table):
        table = table.astype(object)
        table.loc[table.index[rows], column] = value
        return table

    return change


def negated(*columns):
    return lambda table: table.assign(**{c: -table[c] for c in columns})


CIRCUMFERENTIAL = ("circumferential_03", "circumferential_16")

MISTAKES = {
    # how the file is written, how the table is changed, the subject's keys, the message
    "percent called fraction": ({}, None, {"unit": "fraction"}, "set unit: percent"),
    "fraction called percent": (
        {"unit": "fraction"},
        None,
        {"unit": "percent"},
        "set unit: fraction",
    ),
    "curve that ends early": (
        {},
        setting("radial_03", "", slice(15, None)),
        {},
        "line 17: column `radial_03` has 15 values for 20 frames",
    ),
    "no curve": ({}, setting("radial_03", ""), {}, "column `radial_03` is empty; remove it"),
    "word": ({}, setting("radial_03", "x", 4), {}, "line 6: column `radial_03`: `x` is not"),
    "unknown column": (
        {},
        lambda t: t.assign(Ecc_01=0),
        {},
        "line 1: column `Ecc_01` is not known",
    ),
    "segment 18": (
        {},
        lambda t: t.assign(radial_18=0),
        {},
        "line 1: column `radial_18`: that is of the 18-segment model (six apical",
    ),
    "segment 20": ({}, lambda t: t.assign(radial_20=0), {}, "no segment 20 in the models that are"),
    "segment 17 of 16": (
        {},
        lambda t: t.assign(radial_17=0),
        {"segments": 16},
        "the model of 16 segments has no segment 17; set `segments` to",
    ),
    "18 segments called so": (
        {},
        None,
        {"segments": 18},
        "the subject says segments: 18, and there is no segment 18; add it, or remove `segments`",
    ),
    "same twice": ({}, lambda t: t.assign(radial_3=0), {}, "radial_03 occurs twice"),
    "no clock": ({}, lambda t: t.drop(columns="frame"), {}, "no column `frame` nor `time`"),
    "unsorted": ({}, setting("frame", 1, 4), {}, "line 6: frame 1 does not follow 4; sort"),
    "twice around": (
        {},
        lambda t: t.assign(frame=[*range(9, 15), *range(5, 12), *range(1, 8)]),
        {},
        "line 8: frame 5 does not follow 14; sort",
    ),
    "half a frame": (
        {},
        setting("frame", 4.5, 4),
        {},
        "line 6: frame 4.5 is no whole number; name the column time",
    ),
    "nothing moves": (
        {},
        lambda t: t.assign(**{name: 0.0 for name in t.columns if name != "frame"}),
        {},
        "all strains are zero; export them again",
    ),
    "two frames": ({}, lambda t: t[:2], {}, "export the whole cycle"),
    "missing frame": ({}, None, {"frame": 40}, "there is no frame 40; the frames go from 1 to 20"),
    "end diastole": (
        {},
        None,
        {"frame": 1},
        "as large as at end diastole; the unloaded",
    ),
    "ends in systole": (
        {},
        lambda t: t[:9],
        {"frame": "earliest_diastole"},
        "end in frame 9, before the ventricle fills",
    ),
    "filling is missing": (
        {},
        beginning_at(FRAMES - 2, slice(0, 11)),
        {"frame": "earliest_diastole"},
        "frame (11, 97 % of the greatest contraction) and the first (1, 2 %) those are missing",
    ),
    "end systole called end diastole": (
        {"reference": END_SYSTOLE},
        None,
        {"reference": "end_diastole"},
        "not zero in frame 1 (end diastole), and the reference is end_diastole; set reference",
    ),
    "end diastole called end systole": (
        {},
        None,
        {"reference": "end_systole"},
        "zero in frame 1 (end diastole), and the reference is end_systole; set reference: end_dia",
    ),
    "shortening called positive": (
        {},
        negated(*CIRCUMFERENTIAL),
        {},
        "by its circumferential curves, so that they have the wrong sign",
    ),
    "shortening called positive, end systole": (
        {"reference": END_SYSTOLE},
        negated(*CIRCUMFERENTIAL),
        {},
        "by its circumferential curves, so that they have the wrong sign",
    ),
    "one wrong sign": (
        {},
        negated("circumferential_03"),
        {"frame": 8},
        "line 9: circumferential_03 is 0.216",
    ),
    "volume known too well": (
        {},
        None,
        {"sd": {"strain": None, "volume": 0.1}},
        "sd.volume: sd 0.1 mL of a volume of 180 mL: nobody measures it that well",
    ),
    "impossible": (
        {},
        setting("radial_03", -120, 3),
        {},
        "line 5: radial_03 is -1.2: no engin",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistake_names_file_place_and_remedy(write, name):
    how, change, given, message = MISTAKES[name]
    subject = write(**how, change=change) | given
    with pytest.raises(InputError) as error:
        read_curve_subject(subject)
    assert subject["curves"] in str(error.value)
    assert message in str(error.value)


def test_curves_that_the_study_does_not_observe(write):
    channels = Channels.of(("volume", "circumferential", "longitudinal"))
    with pytest.raises(InputError, match=r"radial_03 .*add it to observables\.quantities"):
        read_curve_subject(write(), channels)
