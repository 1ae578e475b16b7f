"""Finished simulations from tables: forms that are read, mistakes that are named, the split."""

import numpy as np
import pandas as pd
import pytest

from regional_lv import aha, config
from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import ZONES, StiffnessInputs
from regional_lv.simulation.tables import import_simulations, read_tables, split

PARAMETERS, CHANNELS = StiffnessInputs(), Channels.of()
ROWS = 30


@pytest.fixture
def simulations():
    rng = np.random.default_rng(1)
    theta = pd.DataFrame(rng.uniform(0.1, 5.0, (ROWS, 10)), columns=list(PARAMETERS.names))
    y = pd.DataFrame(rng.normal(size=(ROWS, 52)), columns=list(CHANNELS.names))
    return theta, y


@pytest.fixture
def files(tmp_path, simulations):
    """The two tables as CSV with named columns; returns their paths."""
    paths = tmp_path / "inputs.csv", tmp_path / "outputs.csv"
    for table, path in zip(simulations, paths, strict=True):
        table.to_csv(path, index=False)
    return paths


def published_order(y: pd.DataFrame) -> pd.DataFrame:
    """Columns as in the published file, written down by name and not by the project's indices."""
    rings = ["inferoseptal", "anteroseptal", "anterior", "anterolateral", "inferolateral"]
    rings += ["inferior"]
    names = [f"{level} {wall}" for level in ("basal", "mid") for wall in rings]
    names += [f"apical {wall}" for wall in ("septal", "anterior", "lateral", "inferior")] + ["apex"]
    number = {segment.name: segment.number for segment in aha.SEGMENTS}
    strains = [f"{d}_{number[name]:02d}" for d in CHANNELS.quantities[1:] for name in names]
    return y[["volume_ml", *strains]]


def test_named_columns_in_any_order_and_with_others(tmp_path, simulations):
    theta, y = simulations
    both = pd.concat([y[y.columns[::-1]], theta], axis=1).assign(note="x")
    for path in (tmp_path / "both.parquet", tmp_path / "both.csv"):
        both.to_parquet(path) if path.suffix == ".parquet" else both.to_csv(path, index=False)
        table = read_tables(path, path, PARAMETERS, CHANNELS)
        assert table["sample"].tolist() == list(range(ROWS))
        np.testing.assert_allclose(table[theta.columns], theta)
        np.testing.assert_allclose(table[y.columns], y)
        assert "note" not in table


def test_published_order_without_header(tmp_path, simulations):
    theta, y = simulations
    theta.to_csv(tmp_path / "x.csv", index=False, header=False)
    published_order(y).to_csv(tmp_path / "y.csv", index=False, header=False)
    table = read_tables(tmp_path / "x.csv", tmp_path / "y.csv", PARAMETERS, CHANNELS)
    np.testing.assert_allclose(table[theta.columns], theta)
    np.testing.assert_allclose(table[y.columns], y)


def test_sensitivities_come_along(tmp_path, simulations):
    theta, y = simulations
    y = y.assign(sensitivity=[np.full(520, float(i)) for i in range(ROWS)])
    theta.to_parquet(tmp_path / "x.parquet")
    y.to_parquet(tmp_path / "y.parquet")
    table = read_tables(tmp_path / "x.parquet", tmp_path / "y.parquet", PARAMETERS, CHANNELS)
    assert table["sensitivity"].map(lambda s: s[0]).tolist() == list(range(ROWS))


def test_any_parameters_and_channels_by_name(tmp_path, simulations):
    parameters = StiffnessInputs({"wall": range(1, 18)}, bounds={"C_a": (0.1, 5), "C_b": (1, 2)})
    channels = Channels.of(["volume", "torsion"], load_fractions=[0.5])
    rng = np.random.default_rng(2)
    theta = pd.DataFrame(rng.uniform(1, 2, (ROWS, 2)), columns=list(parameters.names))
    y = pd.DataFrame(rng.normal(size=(ROWS, 4)), columns=list(channels.names))
    both = pd.concat([y.assign(sensitivity=[np.zeros(8)] * ROWS), theta], axis=1)
    both.to_parquet(tmp_path / "both.parquet")
    table = read_tables(*[tmp_path / "both.parquet"] * 2, parameters, channels)
    assert list(table) == ["sample", *parameters.names, *channels.names, "sensitivity"]
    np.testing.assert_allclose(table[list(channels.names)], y)
    twice = pd.concat([both, both.iloc[2:]])
    twice.to_parquet(tmp_path / "twice.parquet")
    with pytest.raises(InputError, match=rf"twice.parquet: rows 3 and {ROWS + 1} have the same"):
        read_tables(*[tmp_path / "twice.parquet"] * 2, parameters, channels)
    both.assign(C_b_wall=3.0).to_parquet(tmp_path / "far.parquet")
    with pytest.raises(InputError, match=r"row 1, C_b_wall: 3 lies outside \[1, 2\]"):
        read_tables(*[tmp_path / "far.parquet"] * 2, parameters, channels)
    theta.to_csv(tmp_path / "x.csv", index=False, header=False)
    with pytest.raises(InputError, match=r"x\.csv: has no header, and the published order is that"):
        read_tables(tmp_path / "x.csv", tmp_path / "both.parquet", parameters, channels)


def test_the_stiff_zone_of_a_scenario_comes_along(tmp_path, simulations):
    theta, y = simulations
    zone = [PARAMETERS.zone_names[i % 5] for i in range(ROWS)]
    both = pd.concat([theta.assign(zone=zone), y], axis=1)
    both.to_csv(tmp_path / "both.csv", index=False)
    how = *[tmp_path / "both.csv"] * 2, PARAMETERS, CHANNELS
    assert read_tables(*how, PARAMETERS.zone_names)["zone"].tolist() == zone
    assert "zone" not in read_tables(*how)
    with pytest.raises(InputError, match=r"row 1, column zone: 'anterior' is no .* \(all\)"):
        read_tables(*how, ("all",))


def spoil(table: pd.DataFrame, row: int, column: str, value) -> pd.DataFrame:
    table = table.astype(object)
    table.loc[row, column] = value
    return table


MISTAKES = {
    "too few columns": (
        lambda x, y: (x, y.iloc[:, :50], False),
        ["outputs.csv", "50 columns", "52"],
    ),
    "a column that is missing": (
        lambda x, y: (x, y.drop(columns="radial_07"), True),
        ["outputs.csv", "no column radial_07"],
    ),
    "not a number": (
        lambda x, y: (x, spoil(y, 4, "radial_07", "n/c"), True),
        ["outputs.csv", "row 5", "radial_07", "n/c", "remove"],
    ),
    "not finite": (
        lambda x, y: (spoil(x, 2, "C_b_septal", np.inf), y, True),
        ["inputs.csv", "row 3", "C_b_septal"],
    ),
    "an empty cell": (
        lambda x, y: (x, spoil(y, 9, "volume_ml", None), True),
        ["outputs.csv", "row 10", "volume_ml"],
    ),
    "outside the bounds": (
        lambda x, y: (spoil(x, 7, "C_a_apical", 6.5), y, True),
        ["inputs.csv", "row 8", "C_a_apical", "6.5", "[0.1, 5]", "design.upper"],
    ),
    "other rows": (lambda x, y: (x.iloc[:-1], y, True), ["30 rows of outputs to 29 rows"]),
    "nothing": (lambda x, y: (x.iloc[:0], y, True), ["inputs.csv", "holds no rows"]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_name_file_row_and_remedy(mistake, simulations, files):
    change, expected = MISTAKES[mistake]
    *tables, header = change(*simulations)
    for table, path in zip(tables, files, strict=True):
        table.to_csv(path, index=False, header=header)
    with pytest.raises(InputError) as error:
        read_tables(*files, PARAMETERS, CHANNELS)
    for words in expected:
        assert words in str(error.value)


def test_files_that_are_no_tables(tmp_path, files):
    with pytest.raises(InputError, match=r"none\.csv"):
        read_tables(tmp_path / "none.csv", files[1], PARAMETERS, CHANNELS)
    (tmp_path / "ragged.csv").write_text("1,2\n1,2,3\n")
    with pytest.raises(InputError, match="as many cells in every row"):
        read_tables(tmp_path / "ragged.csv", files[1], PARAMETERS, CHANNELS)


def test_split_holds_out_the_same_rows_whatever_is_kept():
    whole, part = split(100, 20, None, 3), split(100, 20, 30, 3)
    assert sorted([*whole["holdout"], *whole["train"]]) == list(range(100))
    assert (part["holdout"] == whole["holdout"]).all() and len(part["train"]) == 30
    assert set(part["train"]) < set(whole["train"])
    assert (split(100, 20, None, 4)["holdout"] != whole["holdout"]).any()
    with pytest.raises(InputError, match="holdout"):
        split(100, 100, None, 3)


def test_sets_are_written_in_the_screened_form(tmp_path, files):
    common = (PARAMETERS, CHANNELS, 3)
    for name in ("train", "test"):
        import_simulations(name, *files, False, 6, None, *common, tmp_path / f"{name}.parquet")
    train, test = (pd.read_parquet(tmp_path / f"{name}.parquet") for name in ("train", "test"))
    assert len(train) == ROWS - 6 and len(test) == 6
    assert not set(train["sample"]) & set(test["sample"])
    # A table of its own is taken whole; the rows held out beside it are those of before.
    import_simulations("test", *files, True, 6, 12, *common, tmp_path / "own.parquet")
    assert len(pd.read_parquet(tmp_path / "own.parquet")) == ROWS
    for name, before in (("train", train), ("holdout", test)):
        import_simulations(name, *files, True, 6, None, *common, tmp_path / "beside.parquet")
        pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "beside.parquet"), before)
    import_simulations("train", *files, True, 0, None, *common, tmp_path / "all.parquet")
    assert len(pd.read_parquet(tmp_path / "all.parquet")) == ROWS


# ------------------------------------------------------------------- what the config says of it


def study(files, **changes) -> dict:
    tables = {"train": dict(zip(("inputs", "outputs"), map(str, files), strict=True))}
    simulations = {"source": "table", "tables": tables, "holdout": 6}
    return {
        "study": "mine",
        "simulations": simulations | changes.pop("simulations", {}),
        "emulators": {"names": ["exact_gp"]},
        "subjects": {},
        "synthetic_subjects": {},
        **changes,
    }


OTHERS = {zone: [*segments] for zone, segments in ZONES["paper"].items()}
OTHERS |= {"anterior": [1, 7, 13], "apical": [14, 15, 16, 17]}
PUBLISHED = {"inputs": "published", "outputs": "published"}


def sizes(given: dict) -> tuple[int, int]:
    """Test cases and rows held out, which loading once more does not change."""
    loaded = config.load(given)
    assert config.load(loaded) == loaded
    return loaded["design"]["test"], loaded["simulations"]["holdout"]


def test_config_counts_the_test_cases(files):
    assert sizes(study(files)) == (6, 6)
    unsaid = study(files, simulations={"holdout": None})
    assert sizes(unsaid | {"design": {"test": 5}}) == (5, 5)
    published = {"train": PUBLISHED}
    assert sizes(study(files, simulations={"tables": published, "holdout": 99})) == (99, 99)
    published["test"] = PUBLISHED
    assert sizes(study(files, simulations={"tables": published})) == (128, 6)


def test_a_test_table_holds_nothing_out_unless_asked(files):
    own = study(files)
    own["simulations"]["tables"]["test"] = own["simulations"]["tables"]["train"]
    assert sizes(own) == (ROWS, 6)
    own["simulations"]["holdout"] = 0
    assert sizes(own) == (ROWS, 0)
    own["simulations"]["holdout"] = None
    assert sizes(own) == (ROWS, 0)


CONFIG_MISTAKES = {
    "few for neighbours": (
        {"emulators": {"names": ["exact_gp", "local_mgp"]}},
        "emulators.local_mgp.neighbours: 24 training simulations are too few",
    ),
    "no sensitivities": (
        {"emulators": {"names": ["exact_gp", "gradient_gp"]}},
        "gradient_gp learns from sensitivities",
    ),
    "no such emulator": ({"emulators": {"names": ["exact_pg"]}}, "did you mean exact_gp"),
    "published table of others": (
        {
            "parameters": {"zones": "whole"},
            "simulations": {"tables": {"train": PUBLISHED}},
        },
        "leave `parameters`, `observables` and `loading.frames` at their defaults",
    ),
    "published table of other zones of the same names": (
        {
            "parameters": {"zones": OTHERS},
            "simulations": {"tables": {"train": PUBLISHED}},
        },
        "leave `parameters`, `observables` and `loading.frames` at their defaults",
    ),
    "other channels": (
        {"loading": {"frames": [0.5]}},
        "no column volume_ml@0.5, circumferential_01@0.5",
    ),
    "few for many parameters": (
        {"parameters": {"zones": "segments"}},
        "no column C_a_segment_01, C_b_segment_01",
    ),
    "few for any": ({"simulations": {"holdout": 20}}, "too few for any emulator"),
    "all held out": ({"simulations": {"holdout": 30}}, "leave none to train on"),
    "cases": ({"test_posteriors": {"cases": 7}}, "7 posteriors on 6 test cases"),
    "no table": ({"simulations": {"tables": {}}}, "simulations.tables.train: missing"),
    "published scenario": (
        {"simulations": {"tables": {"train": PUBLISHED, "local_1_5": PUBLISHED}}},
        "simulations.tables.local_1_5: `published` is the paper's training or test table",
    ),
    "published and own": (
        {"simulations": {"tables": {"train": PUBLISHED, "test": PUBLISHED | {"inputs": "x.csv"}}}},
        "simulations.tables.test: `published` is the paper's training or test table",
    ),
    "a table held out": (
        {"simulations": {"tables": {"train": PUBLISHED, "holdout": PUBLISHED}}},
        "simulations.tables.holdout: the study has no set of this name; use one of train, test, ",
    ),
    "no test set": ({"simulations": {"holdout": 0}}, "simulations.holdout: 0 leaves no test set"),
    "less than nothing": ({"simulations": {"holdout": -1}}, "simulations.holdout: -1 is too small"),
    "tables and simulator": ({"simulations": {"source": "dolfinx"}}, "only `source: table` has it"),
    "synthetic": (
        {
            "subjects": {"one": {"source": "synthetic"}},
            "synthetic_subjects": {"one": {"theta": dict.fromkeys(PARAMETERS.names, 1.0)}},
        },
        "subjects.one: synthetic subjects come out of the simulator",
    ),
}


@pytest.mark.parametrize("mistake", CONFIG_MISTAKES)
def test_config_refuses_before_anything_runs(mistake, files):
    changes, expected = CONFIG_MISTAKES[mistake]
    with pytest.raises(InputError) as error:
        config.load(study(files, **changes))
    assert expected in str(error.value)


def test_config_asks_for_the_zones_of_a_scenario_and_no_more_rows(tmp_path, files, simulations):
    tables = {name: dict(inputs=str(files[0]), outputs=str(files[1])) for name in ("train", "one")}
    scenarios = {"sets": {"one": {"kind": "local", "mu": 2.0, "samples_per_zone": 6}}}
    given = study(files, simulations={"tables": tables}, scenarios=scenarios)
    with pytest.raises(InputError, match=r"tables\.one: .*inputs\.csv: no column zone; name"):
        config.load(given)
    zone = np.repeat(PARAMETERS.zone_names, 6)
    simulations[0].assign(zone=zone).to_csv(tmp_path / "zoned.csv", index=False)
    tables["one"]["inputs"] = str(tmp_path / "zoned.csv")
    config.load(given)
    scenarios["sets"]["one"]["samples_per_zone"] = 5
    with pytest.raises(InputError, match=r"tables\.one: 30 rows for the 25 ventricles of"):
        config.load(given)


def test_config_reads_the_tables(files, simulations):
    _, y = simulations
    spoil(y, 4, "radial_07", np.nan).to_csv(files[1], index=False)
    with pytest.raises(InputError, match=r"simulations.tables.train: .*outputs.csv: row 5"):
        config.load(study(files))
