"""From batches of answers to tables, figures and the page of a cohort."""

import json
import re
from shutil import copyfile

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread

from regional_lv import config as study_config
from regional_lv.errors import InputError
from regional_lv.hearts import hierarchy, summary
from regional_lv.hearts.batches import answer_batch
from regional_lv.hearts.cohort import read_cohort
from regional_lv.hearts.listing import list_hearts, model_of_hearts
from regional_lv.hearts.summary import summarise_cohort
from regional_lv.page.cohort import make_cohort_page
from regional_lv.plots import cohort as plots
from tests.hearts import folders
from tests.hearts.folders import PARAMETERS, answer_as_known

NAMES = (*folders.NAMES, "gina", "hugo", "ines", "jack")


@pytest.fixture(scope="module", autouse=True)
def short_chains():
    """What is made of a population's posterior does not depend on how many draws there are."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hierarchy, "DRAWS", 800)
        yield


@pytest.fixture(scope="module")
def group(tmp_path_factory):
    """Ten hearts in two batches: gina has a damaged file, emil and fred fail, dora cannot be
    trusted. By its name: the listed hearts, and what a job is given of the cohort."""
    folder = folders.write_cohort(tmp_path_factory.mktemp("group"), NAMES)
    (folder / "hearts" / "gina" / "segments.csv").write_text("damaged")
    path = folder / "config.yaml"
    config = study_config.load(path)
    hearts = list_hearts(config["cohort"]["hearts"])
    shared = study_config.read(path)
    found = read_cohort(hearts, shared, [str(folder)], model_of_hearts(config), lambda config: None)
    results = folder / "results"
    results.mkdir()
    known = {
        name: {
            **{"pressure_mmhg": heart.pressure_mmhg, "cavity_ml": heart.cavity_ml},
            **{"wall_ml": heart.wall_ml, "channels": len(heart.table)},
            "warnings": heart.warnings,
        }
        for name, heart in found.hearts.items()
    }
    checked = results / "checked.json"
    checked.write_text(json.dumps({"left_out": found.left_out, "hearts": known}))
    fields = [vars(heart) for heart in hearts]
    batches = {"0000": fields[:4], "0001": fields[4:]}
    for batch, own in batches.items():
        out = results / "hearts" / batch
        answer_batch(own, shared, [str(folder)], checked, out, answer=answer_as_known)
    return results


def summarise(results, batches=("0000", "0001"), name="hearts", prior=(1.0, 1.0)):
    table = results / f"{name}.parquet"
    summarise_cohort(
        sorted(NAMES),
        [results / "hearts" / batch for batch in batches],
        results / "checked.json",
        PARAMETERS,
        prior,
        2026,
        table,
        results / f"{name}_population.csv",
        results / f"{name}_causes.csv",
    )
    return table


@pytest.fixture(scope="module")
def tables(group):
    summarise(group)
    return group


def test_a_failing_heart_fails_alone(group):
    failed = folders.reasons(group / "hearts" / "0001")
    assert failed["emil"] == "emil: no answer; correct it"
    assert failed["fred"] == "ValueError: matrix is not positive definite"
    assert "gina" in failed and set(failed) == {"emil", "fred", "gina"}
    assert folders.reasons(group / "hearts" / "0000") == {}


def test_a_full_disk_is_no_hearts_fault(tmp_path):
    def full(config, folder, notes):
        raise OSError(28, "No space left on device")

    heart = folders.write_heart(tmp_path / "anna")
    fields = {"name": "anna", "file": str(heart / "config.yaml")}
    given = [fields], {"study": "group"}, [], left_out(tmp_path), tmp_path / "batch"
    with pytest.raises(OSError, match="No space left"):
        answer_batch(*given, answer=full)


def left_out(folder, **reasons):
    """The file of a check that leaves hearts out."""
    (folder / "checked.json").write_text(json.dumps({"left_out": reasons}))
    return folder / "checked.json"


def test_the_page_of_a_heart_that_is_left_out_says_why(tmp_path):
    folder = folders.write_heart(tmp_path / "anna")
    fields = {"name": "anna", "file": str(folder / "config.yaml")}
    checked = left_out(tmp_path, anna="looks like kPa", bert="is missing")
    out = tmp_path / "batch"
    answer_batch([fields], {"study": "group"}, [], checked, out, answer=answer_as_known)
    assert (out / "anna" / "page.html").read_text() == (
        "anna\nthis heart is left out of its cohort: looks like kPa"
    )


def test_every_heart_has_a_row(tables):
    table = pd.read_parquet(tables / "hearts.parquet").set_index("heart")
    assert list(table.index) == sorted(NAMES)
    assert set(table.index[table["reason"] != ""]) == {"emil", "fred", "gina"}
    assert "no column `aha_segment`" in table.loc["gina", "reason"]
    answered = table[table["reason"] == ""]
    assert (tables / answered.loc["anna", "page"]).read_text() == "anna"
    assert answered["C_a_septal_lower95"].notna().all()
    # Nothing is concluded with, or about, a heart that cannot be trusted.
    assert not answered.loc["dora", "trusted"] and np.isnan(
        answered.loc["dora", "C_a_septal_pooled"]
    )
    pooled = answered.drop(index="dora")
    shrinkage = pooled[[f"{name}_shrinkage" for name in PARAMETERS.names]].to_numpy(float)
    assert ((shrinkage > 0) & (shrinkage < 1)).all()


def test_population_and_causes(tables):
    population = pd.read_csv(tables / "hearts_population.csv").set_index("parameter")
    assert list(population.index) == list(PARAMETERS.names)
    assert (population["hearts"] == 6).all() and population["rhat"].max() < 1.2
    low, high = (np.log(population[f"mean_{end}95"]) for end in ("lower", "upper"))
    assert ((low < 0.2) & (0.2 < high)).mean() >= 0.8
    causes = pd.read_csv(tables / "hearts_causes.csv").set_index("cause")
    assert causes.index[0] == "septal_load" and (causes["hearts"] == 6).all()
    assert causes.loc["septal_load", "present"] == 2
    assert causes.loc["septal_load", "probability_any"] > 0.9
    assert causes.loc["focal_scar", "log_bayes_factor"] == pytest.approx(0.0, abs=0.5)
    hearts = pd.read_parquet(tables / "hearts.parquet").set_index("heart")
    assert hearts.loc["anna", "septal_load_pooled_probability"] > 0.95
    assert np.isnan(hearts.loc["dora", "septal_load_pooled_probability"])


def test_the_order_of_batches_does_not_matter(tables):
    again = summarise(tables, ("0001", "0000"), "again")
    assert again.read_bytes() == (tables / "hearts.parquet").read_bytes()


def test_a_cause_is_expected_as_in_one_heart_by_itself(tables):
    """As probable as not, which is a uniform prior of the share."""
    again = summarise(tables, name="default", prior=None)
    assert again.read_bytes() == (tables / "hearts.parquet").read_bytes()


def test_a_heart_with_few_draws_of_what_the_others_expect(tables, monkeypatch):
    """Those with a load by themselves, of 400 draws."""
    monkeypatch.setattr(summary, "DRAWS_PER_FACTOR", 38)
    monkeypatch.setattr(hierarchy, "FEWEST", 3)
    hearts = pd.read_parquet(summarise(tables, name="drawn")).set_index("heart")
    few = hearts["warnings"].str.contains("only 3.. effective draws", na=False)
    assert list(hearts.index[few]) == ["anna", "cleo"]
    pooled = hearts["C_a_septal_pooled"].dropna()
    assert list(pooled.index) == ["bert", "hugo", "ines", "jack"]


def test_few_hearts(tables, monkeypatch, tmp_path):
    monkeypatch.setattr(hierarchy, "FEWEST", 7)
    table = summarise(tables, name="few")
    assert pd.read_csv(tables / "few_population.csv").empty
    html = page(tables, "few", tmp_path)
    assert table.exists() and "too few to tell how hearts differ" in html


def test_no_heart_was_answered(group, tmp_path):
    for batch in ("0000", "0001"):
        (tmp_path / batch).mkdir()
        failed = {name: "damaged" for name in NAMES}
        (tmp_path / batch / "failed.json").write_text(json.dumps(failed))
    with pytest.raises(InputError, match=r"no heart was answered(.|\n)*anna: damaged"):
        summarise_cohort(
            sorted(NAMES),
            [tmp_path / "0000", tmp_path / "0001"],
            group / "checked.json",
            PARAMETERS,
            (1.0, 1.0),
            0,
            *(tmp_path / name for name in ("a.parquet", "b.csv", "c.csv")),
        )


def page(tables, name, folder) -> str:
    """Figures and page of tables; the page's text."""
    hearts, population, causes = (
        tables / f"{name}{end}" for end in (".parquet", "_population.csv", "_causes.csv")
    )
    pictures = {key: folder / f"{key}.png" for key in ("stiffness", "pooling", "causes")}
    data = {key: folder / f"{key}.csv" for key in pictures}
    plots.draw_stiffness(hearts, population, PARAMETERS, pictures["stiffness"], data["stiffness"])
    plots.draw_pooling(hearts, PARAMETERS, pictures["pooling"], data["pooling"])
    plots.draw_causes(causes, pictures["causes"], data["causes"])
    for png in pictures.values():
        assert imread(png).std() > 0
    out = folder / "page.html"
    named = {f"{key}_picture": png for key, png in pictures.items()}
    make_cohort_page(
        hearts,
        population,
        causes,
        **named,
        study="group",
        parameters=PARAMETERS,
        limitations="../LIMITATIONS.md",
        page=out,
    )
    return out.read_text()


def test_page(tables, tmp_path):
    hearts = pd.read_parquet(tables / "hearts.parquet")
    hearts["page"] = hearts["page"].str.replace("bert", "50%#1")
    hearts.to_parquet(tables / "odd.parquet", index=False)
    for end in ("population", "causes"):
        copyfile(tables / f"hearts_{end}.csv", tables / f"odd_{end}.csv")
    assert 'href="hearts/0000/50%25%231/page.html">bert' in page(tables, "odd", tmp_path)
    html = page(tables, "hearts", tmp_path)
    assert not re.search(r'(src|href)="https?:', html)
    assert "10 hearts were listed; 7 were answered" in html and "3 failed" in html
    rows = re.findall(r"<tr[^>]*><td data-v=\"(\w+)\"", html)
    assert rows == ["anna", "bert", "cleo", "dora", "hugo", "ines", "jack"]
    assert '<tr class="bad"><td data-v="dora"' in html
    assert "matrix is not positive definite" in html
    assert '<a href="hearts/0000/anna/page.html">anna</a>' in html
    drawn = pd.read_csv(tmp_path / "stiffness.csv")
    assert len(drawn) == 6 * len(PARAMETERS) and "dora" not in set(drawn["heart"])


def test_the_same_cohort_is_the_same_file(tables, tmp_path):
    given = tables / "hearts.parquet", tables / "hearts_population.csv", PARAMETERS
    first, second = (tmp_path / f"{name}.png" for name in "ab")
    for png in (first, second):
        plots.draw_stiffness(*given, png, tmp_path / "stiffness.csv")
    assert first.read_bytes() == second.read_bytes()


def test_a_click_on_a_head_sorts(tables, tmp_path, browser):
    page(tables, "hearts", tmp_path)
    browser.get((tmp_path / "page.html").as_uri())

    def column(at: int) -> list[str]:
        rows = browser.find_elements("css selector", ".hearts tbody tr")
        return [row.find_elements("tag name", "td")[at].get_attribute("data-v") for row in rows]

    heads = browser.find_elements("css selector", ".hearts thead button")
    for at in (1, 0):
        browser.execute_script("arguments[0].click()", heads[at])
        rising = column(at)
        assert rising == sorted(rising, key=float if at else str) and len(rising) == 7
        browser.execute_script("arguments[0].click()", heads[at])
        assert column(at) == rising[::-1]
    severe = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
    assert not severe
