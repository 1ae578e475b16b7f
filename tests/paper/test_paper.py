"""The paper's numbers: complete, well formed, and compared with the right ones of a study."""

import numpy as np
import pandas as pd
import pytest

from regional_lv.channels import Channels
from regional_lv.emulators import REGISTRY
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper import comparison as paper
from regional_lv.paper import page, path

PARAMETERS = StiffnessInputs()
NUMBERS, REASONS = path("numbers.csv"), path("differences.csv")
NOTHING = pd.DataFrame(columns=[*paper.KEYS, "value"])


@pytest.fixture(scope="module")
def numbers():
    return pd.read_csv(NUMBERS, keep_default_na=False)


def test_the_papers_tables_are_complete(numbers):
    """Eight emulators x 2, 10 parameters x 3, 3 emulators x 10 x 4, 12 parameters x 3."""
    sizes = numbers.groupby("place").size()
    expected = {"Table S1": 16, "Table S2": 30, "Table S3": 40, "Table S4": 40, "Table S5": 40}
    assert sizes.loc[list(expected)].to_dict() == expected
    assert sizes["Table S6"] == 36
    assert not numbers.duplicated(["place", *paper.KEYS]).any()


def test_names_are_the_projects(numbers):
    assert set(numbers["emulator"]) <= {*REGISTRY, "", "final", "shortlist"}
    known = {*PARAMETERS.names, "sigma_circumferential", "sigma_radial"}
    in_tables = numbers[numbers["place"].isin([f"Table S{i}" for i in (2, 3, 4, 5, 6)])]
    assert set(in_tables["parameter"]) == known
    assert np.isfinite(numbers["value"].astype(float)).all()


def test_summaries_that_the_paper_prints_follow_from_its_tables(numbers):
    """What is printed twice was read off twice: the copies have to agree."""
    value = numbers.set_index(list(paper.KEYS))["value"].astype(float)
    clinical = numbers[numbers["place"] == "Table S6"]
    for quantity, part in clinical.groupby("quantity"):
        ends = [value[quantity, "final", "volunteer", "all", s] for s in ("min", "max")]
        assert [part["value"].min(), part["value"].max()] == ends
    rhat = numbers[(numbers["quantity"] == "rhat") & (numbers["statistic"] == "median")]["value"]
    ends = [value["rhat", "shortlist", "test", "all", f"{s} median"] for s in ("lowest", "highest")]
    assert [rhat.min(), rhat.max()] == ends
    contraction = numbers[(numbers["place"] == "Table S2")].set_index("parameter")
    pairs = [
        contraction.loc[[f"C_a_{zone}", f"C_b_{zone}"]].groupby("emulator")["value"].agg(list)
        for zone in PARAMETERS.zones
    ]
    assert sum(a < b for pair in pairs for a, b in pair) == 15


def test_nothing_computed_is_said():
    table = paper.compare(NUMBERS, REASONS, NOTHING)
    assert set(table["reason"]) == {paper.ABSENT}
    assert table["ratio"].isna().all()


def test_the_page_has_every_number_and_each_reason_once(tmp_path):
    """One line per row of the paper's table: its values, ours and our choice beside them."""
    rows = [
        paper.row_of("variance_ratio", value, emulator=emulator, set="test", parameter=name,
                     statistic="mean")
        for emulator, value in (("mvgp", 0.5), ("dnn", 0.25), ("final", 0.125))
        for name in PARAMETERS.names
    ]  # fmt: skip
    table = paper.compare(NUMBERS, REASONS, pd.DataFrame(rows))
    page.write_page(table, "# Title", tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text()
    parts = {part.split("\n")[0]: part for part in text.split("\n## ")}
    assert {place[0].upper() + place[1:] for place in table["place"]} == {*parts} - {"# Title"}
    cells = [[c.strip() for c in line.split("|")] for line in parts["Table S2"].splitlines()]
    found = {line[1]: line[2:-1] for line in cells if len(line) > 2}
    assert found["parameter"][:3] == [
        "MVGP: paper",
        "MVGP: this study",
        "MVGP: this study's choice",
    ]
    assert found["C_b septal"] == ["0.0285", "0.5", "0.125", "0.9099", "", "0.0114", "0.25"]
    assert len(found) == 2 + len(PARAMETERS)  # names of columns, line below them
    assert parts["Table S2"].count("wider than they need be") == 1


def test_ratio_reason_and_choice():
    def mse(emulator, value):
        return paper.row_of("parameter_mse", value, emulator=emulator, set="test",
                            parameter="all", statistic="mean")  # fmt: skip

    ours = pd.DataFrame([mse("mvgp", 0.0080), mse("final", 0.0004), mse("local_gp", 0.02)])
    table = paper.compare(NUMBERS, REASONS, ours)
    table = table[table["quantity"] == "parameter_mse"].set_index("emulator")
    assert table.loc["mvgp", "ratio"] == pytest.approx(1.0)
    assert table.loc["mvgp", "chosen_ratio"] == pytest.approx(0.05)
    assert "weighted" in table.loc["mvgp", "reason"]
    assert table.loc["local_gp", "ratio"] == pytest.approx(0.02 / 2.0639)
    assert "neighbours enough" in table.loc["local_gp", "reason"]  # the more specific reason
    assert table.loc["dnn", "reason"] == paper.ABSENT


@pytest.mark.parametrize(
    ("quantity", "value", "relation", "ours", "expected"),
    [
        ("ess", 400, ">", 700, False),
        ("ess", 400, ">", 300, True),
        ("variance_ratio", 0.04, "<", 0.03, False),
        ("coverage95", 96.3, "=", 94.0, False),
        ("coverage95", 96.3, "=", 92.0, True),
        ("parameter_mse", 0.01, "=", 0.014, False),
        ("parameter_mse", 0.01, "=", 0.005, True),
        ("outside95", 0, "=", 1, True),
        ("outside95", 0, "=", 0, False),
    ],
)
def test_differs(quantity, value, relation, ours, expected):
    assert paper.differs(quantity, value, relation, ours) == expected


def test_a_reason_for_an_unknown_quantity_is_refused(tmp_path):
    table = pd.read_csv(REASONS, dtype=str, keep_default_na=False)
    table.loc[0, "quantity"] = "simulaton_minutes"
    table.to_csv(tmp_path / "why.csv", index=False)
    with pytest.raises(InputError, match="simulaton_minutes"):
        paper.compare(NUMBERS, tmp_path / "why.csv", NOTHING)
    table.drop(columns="reason").to_csv(tmp_path / "why.csv", index=False)
    with pytest.raises(InputError, match="no column reason"):
        paper.compare(NUMBERS, tmp_path / "why.csv", NOTHING)


# What is collected from a study's files


@pytest.fixture
def study(tmp_path):
    """The files of a study with two emulators, of which `exact_gp` was chosen."""

    def file(name, table):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".parquet":
            table.to_parquet(path)
        else:
            table.to_csv(path, index=False)
        return path

    train = pd.DataFrame({"scale": ["natural"] * 5 + ["log"] * 2, "cpu_s": 3.0})
    files = {"screened": [file("train.parquet", train), file("test.parquet", train.iloc[:3])]}
    explained = pd.DataFrame({"kept": [True, True, True, False]})
    files["explained"] = file("explained.csv", explained)
    files["coverage"], files["diagnostics"] = [], []
    for emulator, ratio in (("exact_gp", 0.01), ("dnn", 0.02), ("final", 0.01)):
        names = [*PARAMETERS.names, "all"]
        covered = pd.DataFrame({"parameter": names, "coverage95": 0.95, "variance_ratio": ratio})
        covered.loc[covered["parameter"].str.startswith("C_b"), "variance_ratio"] *= 2
        checks = pd.DataFrame(
            [(c, n, 1 + 0.01 * c, 500.0 + 100 * c) for c in range(3) for n in PARAMETERS.names],
            columns=["case", "parameter", "rhat", "ess_bulk"],
        )
        folder = f"{emulator}/test"
        files["coverage"].append(file(f"{folder}/coverage.csv", covered))
        files["diagnostics"].append(file(f"{folder}/diagnostics.csv", checks))
    files["zone_correlations"] = [
        file(
            f"final/{name}/zone_correlations.csv",
            pd.DataFrame({"zone_1": ["anterior"], "zone_2": ["septal"], "mean": [mean]}),
        )
        for name, mean in (("local_1_5", -0.5), ("local_3_0", -0.7), ("global_1_7", -0.6))
    ]
    names = [*PARAMETERS.names, "sigma_circumferential", "sigma_radial"]
    convergence = pd.DataFrame({"parameter": names, "rhat": 1.001, "split_rhat": 1.002})
    convergence["ess"] = np.linspace(500, 900, 12)
    drawn = pd.DataFrame(
        [("sigma_radial", item, v) for item, v in (("median", 0.5), ("lower95", 0.4))],
        columns=["parameter", "item", "value"],
    )
    seen = pd.DataFrame(
        {
            "quantity": ["volume", "radial", "radial", "radial"],
            "item": ["observed"] * 3 + ["median"],
        }
        | {"inside": [True, False, True, None]}
    )
    files["volunteer"] = [file("c.csv", convergence), file("b.csv", drawn), file("p.csv", seen)]
    ranked = {"emulator": ["exact_gp", "dnn"], "param_mse_least_squares": [0.02, 0.03]}
    ranked |= {"param_mse_weighted": [0.01, 0.04], "output_mse": [1e-3, 2e-3]}
    pairs = pd.DataFrame(
        {"estimator": ["least_squares"] * 2 + ["weighted"], "rejected": [True, True, True]}
        | {"multi": ["mvgp", "local_mgp", "mvgp"], "better": ["mvgp", "local_gp", "mvgp"]}
    )
    files["estimates"] = [file("ranking.csv", pd.DataFrame(ranked)), file("pairs.csv", pairs)]
    (tmp_path / "final.json").write_text('{"final": "exact_gp"}')
    files["choice"], files["channels"] = tmp_path / "final.json", Channels.of()
    return files


def test_reduced_outputs_count_the_volumes_of_every_load(study):
    for channels, expected in (
        (Channels.of(load_fractions=[0.5]), 5),
        (Channels.of(["radial"]), 3),
    ):
        (row,) = paper.from_reduction(study["explained"], channels)
        assert row["value"] == expected


def test_simulations_out_of_tables_have_no_scale(tmp_path):
    pd.DataFrame({"sample": range(7)}).to_parquet(tmp_path / "train.parquet")
    found = paper.from_simulations({"train": tmp_path / "train.parquet"})
    assert [(row["parameter"], row["value"]) for row in found] == [("all", 7)]


def test_a_study_is_collected(study, tmp_path):
    written = {"csv": tmp_path / "t" / "p.csv", "md": tmp_path / "t" / "p.md"}
    paper.compare_study(NUMBERS, REASONS, **study, **written)
    table = pd.read_csv(written["csv"], keep_default_na=False)
    sections = written["md"].read_text().split("\n## ")[1:]
    tables = [[line for line in s.splitlines() if line.startswith("| ")] for s in sections]
    assert sum(t[0].count("paper |") * (len(t) - 1) for t in tables) == len(table)
    for column in ("ours", "chosen"):
        table[column] = pd.to_numeric(table[column])
    value = table.set_index(list(paper.KEYS))[["ours", "chosen"]]
    ours, chosen = value["ours"], value["chosen"]
    assert ours["simulations_kept", "", "train", "log", ""] == 2
    assert ours["simulation_minutes", "", "", "", ""] == pytest.approx(0.05)
    assert ours["reduced_outputs", "", "train", "", ""] == 4  # three components and the volume
    assert ours["variance_ratio", "dnn", "test", "C_b_septal", "mean"] == pytest.approx(0.04)
    assert chosen["variance_ratio", "mvgp", "test", "C_b_septal", "mean"] == pytest.approx(0.02)
    assert ours["rhat", "shortlist", "test", "all", "highest median"] == pytest.approx(1.01)
    assert ours["c_a_contracts_more_than_c_b", "shortlist", "test", "all", "count"] == 10
    low, high = "lowest mean", "highest mean"
    assert ours["zone_correlation", "final", "local", "anterior-septal", low] == -0.7
    assert ours["zone_correlation", "final", "local", "anterior-septal", high] == -0.5
    assert ours["outside95", "final", "volunteer", "all", "count"] == 1
    assert ours["outside95", "final", "volunteer", "volume", "count"] == 0
    assert ours["noise", "final", "volunteer", "sigma_radial", "hpd_lower95"] == 0.4
    assert ours["ess", "final", "volunteer", "all", "max"] == 900
    assert ours["parameter_mse", "dnn", "test", "all", "mean"] == 0.03
    assert chosen["parameter_mse", "mvgp", "test", "all", "mean"] == 0.01
    assert ours["pairs_rejected", "", "test", "", "count"] == 1
    assert "exact in the paper, and known to 0.5 % here" in written["md"].read_text()
    unexplained = table[table["reason"] == paper.UNEXPLAINED]
    assert set(unexplained["quantity"]) == {"observations"}  # three here, of a real volunteer 33
    study["volunteer"] = []
    header = pd.read_csv(study["estimates"][1]).iloc[:0]
    header.to_csv(study["estimates"][1], index=False)  # no pair was complete
    paper.compare_study(NUMBERS, REASONS, **study, **written)
    fewer = pd.read_csv(written["csv"], keep_default_na=False)
    fewer = fewer.set_index(list(paper.KEYS))["reason"]
    assert fewer["pairs_rejected", "", "test", "", "count"] == paper.ABSENT
    assert fewer["noise", "final", "volunteer", "sigma_radial", "median"] == paper.ABSENT
