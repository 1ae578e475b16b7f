"""The page of a subject: it stands alone, hides no failure, and a browser draws all of it."""

import json
import re
from io import BytesIO

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread
from selenium.webdriver import ActionChains
from selenium.webdriver.support.wait import WebDriverWait

from regional_lv.channels import Channels
from regional_lv.criticism.case_posterior import AveragedPosterior
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured import write_measured
from regional_lv.measured.tables import make_table
from regional_lv.page.page import (
    _hover,
    make_page,
    make_page_of_several,
    measured_of,
    missing,
    stiffness_of,
)
from regional_lv.plots import (
    bullseye_posterior,
    criticism,
    measured_strains,
    posterior_predictive,
    zones,
)
from regional_lv.quantities import QUANTITIES, SEGMENT_PLACES, Quantity
from regional_lv.registry import temporary
from tests.criticism.findings_example import DRAWS, example, misfit, write_posterior

PARAMETERS, CHANNELS = StiffnessInputs(), Channels.of()
LEVEL = {"volume": 150.0, "circumferential": -0.12, "radial": 0.4, "longitudinal": -0.14}
OF_CRITICISM = ("residuals", "causes", "effects", "sources")


def observed() -> pd.DataFrame:
    """A measured table; longitudinal strains and the apex are missing."""
    rng = np.random.default_rng(5)
    rows = [
        {
            **{"output": c.name, "quantity": c.quantity, "segment": c.segment, "place": c.place},
            **{"value": LEVEL[c.quantity] * (1 + 0.1 * rng.standard_normal()), "unit": c.unit},
            **{"sd": 1.0 if c.quantity == "volume" else 0.01, "load_fraction": 1.0},
        }
        for c in CHANNELS
        if c.quantity != "longitudinal" and c.segment != 17
    ]
    return pd.DataFrame(rows).astype({"segment": "Int64"})


@pytest.fixture(scope="module")
def files(tmp_path_factory, small_mesh):
    """What the page of a heart needs, by name."""
    folder, table = tmp_path_factory.mktemp("page"), observed()
    made = {name: folder / name for name in ("measured.csv", "final.json", "test.parquet")}
    made |= {name: folder / f"{name}.png" for name in ("strains", "zones")}
    write_measured(table, made["measured.csv"])
    made["final.json"].write_text(json.dumps({"final": "gradient_gp"}))
    pd.DataFrame(
        [(case, o, 1.0, 1.001) for case in range(3) for o in CHANNELS.names],
        columns=["case", "output", "truth", "mean"],
    ).to_parquet(made["test.parquet"])
    data = folder / "data.csv"
    measured_strains.draw(
        made["measured.csv"], "heart", "synthetic", PARAMETERS, made["strains"], data
    )
    zones.draw(small_mesh, PARAMETERS, made["zones"], data)
    return made


@pytest.fixture(scope="module")
def common(files, small_mesh):
    """Arguments of `make_page` that do not depend on the posterior."""
    return {
        **{"subject": "heart", "study": "toy", "source": "synthetic", "emulator": "final"},
        **{"measured": files["measured.csv"], "choice": files["final.json"]},
        **{"predictions": files["test.parquet"], "strains_picture": files["strains"]},
        **{"zones_picture": files["zones"], "mesh": small_mesh},
        **{"parameters": PARAMETERS, "channels": CHANNELS, "pressure_mmhg": 8.0},
        **{"strain_exponent": 2.0, "scales_with_pressure": True},
        "limitations": "LIMITATIONS.md",
    }


def picture(folder):
    return folder / "stiffness.png", folder / "fit.png"


@pytest.fixture(scope="module")
def averaged(common, tmp_path_factory):
    """All arguments; C_b of the apex is its prior."""
    folder, table = tmp_path_factory.mktemp("averaged"), observed().set_index("output")
    nc, findings, data = (folder / n for n in ("posterior.nc", "findings.json", "data.csv"))
    content = example(outputs=table.index.tolist())
    findings.write_text(json.dumps(content))
    prior = {"C_b_apical": np.random.default_rng(2).uniform(0.1, 5.0, DRAWS)}
    write_posterior(content, table["value"].to_dict(), table["sd"].to_dict(), nc, prior)
    stiffness, fit = picture(folder)
    bullseye_posterior.draw(nc, findings, "synthetic", PARAMETERS, stiffness, data)
    posterior_predictive.draw(nc, findings, "synthetic", fit, data)
    of_criticism = {name: folder / f"{name}.png" for name in OF_CRITICISM}
    tables = [path.with_suffix(".csv") for path in of_criticism.values()]
    criticism.draw(findings, PARAMETERS, **of_criticism, tables=tables)
    return common | {
        **{"posterior": nc, "findings": findings},
        **{"stiffness_picture": stiffness, "fit_picture": fit, "extended": "extended.yaml"},
        **{f"{name}_picture": png for name, png in of_criticism.items()},
    }


def made(given, tmp_path, **changes) -> str:
    """The page as HTML, with other arguments."""
    make_page(**given | changes, page=tmp_path / "page.html")
    return (tmp_path / "page.html").read_text()


def text_of(page: str) -> str:
    """What a reader sees, in single spaces."""
    body = re.sub(r"<(script|style).*?</\1>", " ", page, flags=re.DOTALL)
    body = re.sub(r"</(td|th|li|p|h\d)>", " ", body).replace("&nbsp;", " ")
    body = body.replace("&plusmn;", "±")
    return " ".join(re.sub(r"<[^>]+>", "", body).split())


def section(page: str, name: str) -> str:
    return text_of(re.search(rf'<section id="{name}">.*?</section>', page, re.DOTALL).group())


def with_findings(given, tmp_path, **changes) -> dict:
    """Arguments with other findings."""
    table = json.loads(given["findings"].read_text())["misfit"]["channels"]
    content = example(outputs=[row["output"] for row in table], **changes)
    (tmp_path / "findings.json").write_text(json.dumps(content))
    return given | {"findings": tmp_path / "findings.json"}


@pytest.fixture(scope="module")
def page(averaged, tmp_path_factory) -> str:
    return made(averaged, tmp_path_factory.mktemp("made"))


def stands_alone(html: str) -> int:
    """The number of pictures of a page that loads nothing."""
    outside = re.sub(r"<script.*?</script>", "", html, flags=re.DOTALL)
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", outside)
    assert not re.search(r"<(link|iframe|object)\b|@import|url\(", outside)
    assert not re.search(r"<script[^>]*\bsrc=", html)
    return outside.count('src="data:image/png;base64,')


def test_the_page_needs_nothing_but_itself(page):
    assert stands_alone(page) == 8
    order = re.findall(r'<section id="(\w+)"', page)
    assert order == ["stiffness", "wrong", "measured", "shape", "fit", "next", "sure"]


def test_what_was_measured_and_what_was_not(averaged, tmp_path):
    html = made(with_findings(averaged, tmp_path, measured_inputs=[]), tmp_path)
    assert "SYNTHETIC DATA" in html
    shown, table = section(html, "measured"), observed()
    volume = table.loc[table["quantity"] == "volume", "value"].item()
    assert f"the volume {volume:.4g} mL 1" in shown
    assert "circumferential strain 16 of 17" in shown
    assert (
        "Not measured: circumferential strain of segment 17; radial strain of segment 17; "
        "longitudinal strain." in shown
    )
    assert "8 mmHg is assumed and was simulated" in shown
    assert "if the true pressure is 10 % higher" in shown
    whole = pd.DataFrame({"output": CHANNELS.names})
    assert missing(whole, CHANNELS) == []


def test_what_is_no_strain_is_not_read_in_percent():
    """Of the quantities of a plugin: one of segments, in mm."""
    with temporary():

        @QUANTITIES.add
        class Thickness(Quantity):
            name, unit, limits, noise = "thickness", "mm", (1.0, 40.0), "thickness"
            places = SEGMENT_PLACES

            def values(self, motion, places):
                return None

        channels = Channels.of(("volume", "thickness", "radial"))
        table = make_table(channels, np.array([150.0, *[9.5] * 17, *[0.4] * 17]))
        thickness, radial = measured_of(table, channels)[1:]
        assert (thickness["what"], thickness["value"]) == ("thickness", "9.5 (9.5 to 9.5)")
        assert thickness["unit"] == "mm"
        assert (radial["what"], radial["value"]) == ("radial strain", "40.0 (40.0 to 40.0)")
        label = _hover([], table, PARAMETERS)[0]
        assert label.endswith("<br>thickness: 9.5 mm<br>radial strain: 40.0 %")


def test_a_pressure_that_is_integrated_out_needs_no_warning(page):
    shown = section(page, "measured")
    assert "8 ± 2 mmHg is assumed" in shown and "if the true pressure" not in shown
    assert "end-diastolic pressure, if it was not measured" not in section(page, "next")
    assert "taken as known" not in section(page, "sure")


def test_the_averaged_stiffness_comes_first_with_the_model_as_it_is_beside_it(page, averaged):
    shown = section(page, "stiffness")
    answer = "Named: septal load and focal scar in segment 7 (mid anterior). The model as it is has"
    assert shown.startswith(f"Stiffness by zone {answer} a probability of 0.4 %.")
    content = json.loads(averaged["findings"].read_text())
    for row in content["stiffness"]:
        mean, base = row["averaged"], row["as_it_is"]
        low, high = mean["interval95"]
        assert (
            f"{mean['mean']:.2f} ± {mean['sd']:.2f} {low:.2f} to {high:.2f} "
            f"{base['mean']:.2f} ± {base['sd']:.2f} {row['shift_sd']:+.1f} " in shown
        )
    assert re.findall(r"<b>(\+\d\.\d)</b>", page) == ["+7.0"]  # what moves by more than one sd
    assert "The data do not constrain Cb apical:" in shown


def test_measured_inputs_that_the_data_moved_most_are_shown(page):
    table = section(page, "stiffness").split("Measured inputs", 1)[1]
    first, rest = table.split("12 more, which the data moved less")
    assert first.count("wall thickness of segment") == 6 and "9 ± 1 9.8 ± 0.8 mm" in first
    assert "end diastolic pressure 8 ± 2 8.4 ± 1.6 mmHg" in rest


def test_the_criticism_is_a_part_of_the_page(page, averaged):
    shown = section(page, "wrong")
    content = json.loads(averaged["findings"].read_text())
    for sentence in content["words"]:
        assert sentence in shown
    assert "walls, direction by direction 0.003 0.400 listed causes 0.003 0.400" in shown
    first = "septal load + focal scar in segment 7 (mid anterior) 0.900"
    assert first in shown and "the model as it is 0.004" in shown
    assert "a smooth departure of no listed shape 0.010" in shown
    assert "fibre rotation 0.941 3 deg (95 % interval" in shown
    worst = max(content["confirmation"]["channels"], key=lambda c: c["error_sd"])
    assert f"{worst['error_sd']:.1f}" in shown.split("Confirmation by simulation")[1][:600]
    assert "rms error, volume (mL) 2.2 1.1" in shown and "no torsion was measured" in shown
    assert "snakemake --cores 2 pages --configfile extended.yaml" in shown
    assert "12 simulations" in shown and "1240" in section(page, "sure")


def test_where_no_stiffness_can_be_trusted_the_first_line_says_so(averaged, tmp_path):
    lost = {"trusted": False, "explained": False, "named": [], "remaining": None, "best": None}
    html = made(with_findings(averaged, tmp_path, **lost), tmp_path, source="file")
    shown = text_of(html[html.index("<body>") :])
    assert shown.startswith("No stiffness of this heart can be trusted: every model")
    assert "Tried: the model as it is (p = 0.003)" in shown
    assert "extended.yaml" not in shown


def test_what_to_measure_next_stands_in_its_own_section(averaged, tmp_path):
    gap = {"output": "volume_ml", "load_fraction": 1.0, "noise": 1.0, "difference_in_noise_sd": 4.0}
    pair = {"pair": [["septal_load"], ["fibre_rotation"]], "components": [[""], [""]]}
    separating = [pair | {"channels": [gap]}]
    group = {"named": [], "groups": [["septal_load", "fibre_rotation"]], "separating": separating}
    html = made(with_findings(averaged, tmp_path, **group), tmp_path)
    assert "would separate septal load from fibre rotation best" in section(html, "next")
    assert "would separate" not in section(html, "wrong")
    assert "is present; the data cannot tell which" in section(html, "wrong")


def test_a_heart_that_the_model_fits(averaged, tmp_path):
    outputs = observed()["output"].tolist()
    nothing = {"hypotheses": [], "sets": [], "named": [], "best": None, "remaining": None}
    nothing["gain"] = dict.fromkeys(example()["gain"]) | {"coverage_before": 0.95}
    nothing |= {"explained": False, "measured_inputs": [], "base_probability": 0.97}
    quiet = with_findings(averaged, tmp_path, **nothing, misfit=misfit(outputs, 0.8))
    for name in OF_CRITICISM:
        quiet[f"{name}_picture"] = tmp_path / f"{name}.png"
    files = {name: quiet[f"{name}_picture"] for name in OF_CRITICISM}
    tables = [path.with_suffix(".csv") for path in files.values()]
    criticism.draw(quiet["findings"], PARAMETERS, **files, tables=tables)
    html = made(quiet, tmp_path)
    assert "The model as it is fits the measurements. The model as it is has" in text_of(html)
    shown = section(html, "wrong")
    assert "No cause was searched: the emulator knows" in shown and "Causes one by one" not in shown
    assert "What the best set gains" not in shown
    assert "the model as it is 0.970" in shown and "a smooth departure of no listed" in shown


def test_several_hearts_together_have_a_page(averaged, tmp_path):
    changed = with_findings(averaged, tmp_path, subject="both", subjects=["anna", "bert"])
    make_page_of_several(
        changed["findings"],
        **{f"{name}_picture": changed[f"{name}_picture"] for name in OF_CRITICISM},
        page=tmp_path / "page.html",
    )
    html = (tmp_path / "page.html").read_text()
    assert stands_alone(html) == 4
    assert "both: what the model gets wrong about 2 hearts together anna, bert." in text_of(html)
    assert "Named: septal load" in section(html, "wrong")


def test_factors_that_compensate_each_other_and_one_that_is_the_prior(averaged, page, tmp_path):
    table, content = observed().set_index("output"), json.loads(averaged["findings"].read_text())
    rng = np.random.default_rng(0)
    ridge = 0.2 * rng.standard_normal(DRAWS)
    lateral = {"C_a_lateral": 1.5 * np.exp(ridge), "C_b_lateral": 1.7 * np.exp(-ridge)}
    lateral = {k: v * np.exp(0.02 * rng.standard_normal(DRAWS)) for k, v in lateral.items()}
    nc = tmp_path / "ridge.nc"
    write_posterior(content, table["value"].to_dict(), table["sd"].to_dict(), nc, lateral)
    shown = section(made(averaged, tmp_path, posterior=nc), "stiffness")
    assert (
        "In the zone lateral, Ca and Cb compensate each other (correlation of their logarithms -0.9"
        in shown
    )
    assert shown.count("compensate each other") == 1
    mean = re.search(r"geometric mean of the zone's factors is (\d\.\d\d) ", shown).group(1)
    assert float(mean) == pytest.approx(np.sqrt(1.5 * 1.7), abs=0.02)
    unconstrained = "The data do not constrain Cb apical; not measured in its zone:"
    assert unconstrained in section(page, "next")


@pytest.mark.parametrize(("share", "silent"), [(1.0, True), (0.5, False)])
def test_a_parameter_whose_draws_are_those_of_the_prior_is_not_constrained(share, silent):
    """Wherever its bounds are; draws of the lower half of the range tell something."""
    parameters = StiffnessInputs(bounds=(2.0, 5.0))
    even = share * (np.arange(200) + 0.5) / 200
    draws = {p.name: (p.low + (p.high - p.low) * even)[None] for p in parameters}
    number = {"mean": 1.0, "sd": 0.1, "interval95": [0.8, 1.2]}
    stated = {"unit": "1", "averaged": number, "as_it_is": number, "sources": {}, "shift_sd": 0.0}
    drawn = AveragedPosterior(
        **{"file": "heart.nc", "groups": {}, "case": "heart", "parameters": parameters.names},
        **{"draws": draws, "verdict": "passed", "truth": {}, "as_it_is": draws},
        stiffness=tuple({"name": name, **stated} for name in parameters.names),
    )
    assert {row["silent"] for row in stiffness_of(drawn, parameters)} == {silent}


def test_what_users_typed_is_text(averaged, tmp_path):
    bad = "<script>alert(1)</script>"
    content = {"limits": [f"{bad} & more"]}
    changed = with_findings(averaged, tmp_path, **content) | {"subject": bad, "study": bad}
    html = made(changed, tmp_path)
    assert bad not in html
    assert html.count("&lt;script&gt;alert(1)&lt;/script&gt;") == 4


def test_without_a_simulator_there_is_no_heart_to_show(averaged, tmp_path):
    html = made(averaged, tmp_path, mesh=None, zones_picture=None, source="file")
    assert "<script" not in html and "SYNTHETIC" not in html


def test_an_emulator_has_its_errors_if_it_was_tested(averaged, tmp_path):
    chosen = section(made(averaged, tmp_path), "sure")
    assert "on 3 simulated" in chosen and "an emulator (Gradient GP)" in chosen
    untested = made(averaged, tmp_path, emulator="gradient_gp", choice=None, predictions=None)
    assert "rms error of the emulator" not in untested


# ------------------------------------------------------------------------------- in a browser


def seen(element) -> np.ndarray:
    """What a browser shows of an element: (h, w, 3), 0 to 1."""
    return imread(BytesIO(element.screenshot_as_png))[..., :3]


def test_a_browser_draws_everything_and_nothing_errs(browser, page, tmp_path):
    (tmp_path / "page.html").write_text(page)
    browser.get((tmp_path / "page.html").as_uri())
    heart = browser.find_element("id", "heart")
    wait = WebDriverWait(browser, 120)
    wait.until(lambda b: b.find_elements("css selector", "#heart canvas"))

    def drawn() -> np.ndarray:
        browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", heart)
        return seen(heart)

    wait.until(lambda _: (np.ptp(drawn(), axis=-1) > 0.2).mean() > 0.05)
    zones_shown = drawn()

    # To turn: what is under the pointer names its segment; a button colours by a factor.
    ActionChains(browser).move_to_element(heart).perform()
    wait.until(lambda b: "segment 12" in b.find_element("css selector", "#heart .hovertext").text)
    buttons = browser.find_elements("css selector", "#heart .updatemenu-button")
    assert len(buttons) == 1 + len(PARAMETERS.factors)
    ActionChains(browser).move_to_element(buttons[1]).click().perform()
    wait.until(lambda b: b.find_elements("css selector", "#heart .colorbar"))
    wait.until(lambda _: np.abs(drawn() - zones_shown).mean() > 0.01)

    widths = [i.get_property("naturalWidth") for i in browser.find_elements("tag name", "img")]
    assert len(widths) == 8 and min(widths) > 300
    errors = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
    assert not errors, errors


def test_a_telephone_shows_it_without_scrolling_sideways(browser, page, tmp_path):
    (tmp_path / "page.html").write_text(page)
    metrics = {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    browser.get((tmp_path / "page.html").as_uri())
    assert browser.execute_script("return innerWidth") == 400
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 400
    heart = browser.find_element("id", "heart")
    assert 300 < heart.size["width"] <= 400
