"""The page of a subject: it stands alone, hides no failure, and a browser draws all of it."""

import json
import re
import shutil
from dataclasses import replace
from io import BytesIO

import arviz as az
import numpy as np
import pandas as pd
import pytest
import torch
import xarray as xr
from matplotlib.image import imread
from selenium import webdriver
from selenium.webdriver import ActionChains
from selenium.webdriver.support.wait import WebDriverWait

from regional_lv.criticism import words
from regional_lv.criticism.findings import write_findings
from regional_lv.criticism.report import write_report
from regional_lv.criticism.study import criticise
from regional_lv.criticism.verdict import Settings
from regional_lv.measured import write_measured
from regional_lv.page.page import make_page, missing
from regional_lv.plots import bullseye_posterior, measured_strains, posterior_predictive, zones
from tests.criticism.test_verdict import inputs
from tests.criticism.toy import (
    CHANNELS,
    PARAMETERS,
    THETA,
    Extension,
    ToyEmulator,
    basal,
    measured,
    pattern,
    simulate,
)

SETTINGS = Settings(
    bootstrap=39, level=0.05, draws=100, largest_set=1, sets=2, simulations=4, rounds=1
)
FAILED = "failed: R-hat 1.600 > 1.01"


def sampled(emulator, table, path):
    """Draws about the truth: C_a and C_b of the lateral wall compensate each other, C_b of the apex
    is the prior."""
    rng = np.random.default_rng(0)
    theta = THETA.numpy() * np.exp(0.05 * rng.standard_normal((2, 200, 1, 10)))
    lateral = PARAMETERS.of_zone("lateral")
    ridge = np.array([[0.2], [-0.2]]) @ rng.standard_normal((2, 200, 1, 1, 1))
    theta[..., lateral] = THETA.numpy()[lateral] * np.exp(
        ridge[..., 0] + 0.02 * rng.standard_normal((2, 200, 1, 2))
    )
    theta[..., PARAMETERS.names.index("C_b_apical")] = rng.uniform(0.1, 5.0, (2, 200, 1))
    names = table["output"].tolist()
    mean = emulator.predict_mean(torch.as_tensor(theta)).numpy()
    mean = mean[..., [CHANNELS.names.index(name) for name in names]]
    case = {"case": ["heart"]}
    az.InferenceData(
        posterior=xr.Dataset(
            {"theta": (("chain", "draw", "case", "parameter"), theta)},
            {**case, "parameter": list(PARAMETERS.names)},
        ),
        constant_data=xr.Dataset(
            {"y_obs": (("case", "output"), table["value"].to_numpy()[None])},
            {**case, "output": names},
        ),
        posterior_predictive=xr.Dataset(
            {
                "y": (
                    ("chain", "draw", "case", "output"),
                    mean + table["sd"].to_numpy() * rng.standard_normal(mean.shape),
                )
            },
            {**case, "output": names},
        ),
    ).to_netcdf(str(path))


@pytest.fixture(scope="module")
def given(tmp_path_factory, small_mesh):
    """Arguments of `make_page` for a heart in closed form with an effect of two possible causes,
    whose longitudinal strains and apex were not measured."""
    folder, emulator = tmp_path_factory.mktemp("page"), ToyEmulator()
    table = measured(emulator, basal(), 0.8, seed=5)
    table = table[(table["quantity"] != "longitudinal") & (table["segment"] != 17).fillna(True)]
    twin = replace(basal().hypothesis, name="twin")
    causes = [basal(), Extension(twin, basal().pattern + pattern("radial", [16], 0.01))]
    found = criticise(inputs({"heart": table}, causes, (), SETTINGS), simulate(causes))

    files = {
        name: folder / name
        for name in (
            *("measured.csv", "heart.nc", "diagnostics.csv", "final.json", "test.parquet"),
            *("findings.json", "residuals.png", "strains.png", "stiffness.png", "fit.png"),
            *("zones.png", "data.csv"),
        )
    }
    write_measured(table, files["measured.csv"])
    write_findings(found, files["findings.json"])
    sampled(emulator, table, files["heart.nc"])
    diagnosed(files["diagnostics.csv"], "passed")
    numbers = {"coverage95": 0.94, "coverage95_lower": 0.9, "coverage95_upper": 0.97, "cases": 64}
    chosen = {"final": "gradient_gp", "candidates": [{"emulator": "gradient_gp"} | numbers]}
    files["final.json"].write_text(json.dumps(chosen))
    pd.DataFrame(
        [(case, o, 1.0, 1.001) for case in range(3) for o in CHANNELS.names],
        columns=["case", "output", "truth", "mean"],
    ).to_parquet(files["test.parquet"])

    of_subject = files["heart.nc"], files["diagnostics.csv"], "synthetic"
    data = files["data.csv"]
    measured_strains.draw(
        files["measured.csv"], "heart", "synthetic", PARAMETERS, files["strains.png"], data
    )
    bullseye_posterior.draw(*of_subject, PARAMETERS, files["stiffness.png"], data)
    posterior_predictive.draw(*of_subject, files["fit.png"], data)
    zones.draw(small_mesh, PARAMETERS, files["zones.png"], data)
    write_report(files["findings.json"], folder / "report.html", files["residuals.png"], data)
    return {
        **{"subject": "heart", "study": "toy", "source": "synthetic", "emulator": "final"},
        **{"measured": files["measured.csv"], "posterior": files["heart.nc"]},
        **{"diagnostics": files["diagnostics.csv"], "choice": files["final.json"]},
        **{"predictions": files["test.parquet"], "findings": files["findings.json"]},
        **{f"{n}_picture": files[f"{n}.png"] for n in ("strains", "stiffness", "fit", "zones")},
        **{"residuals_picture": files["residuals.png"], "mesh": small_mesh},
        **{"parameters": PARAMETERS, "channels": CHANNELS, "pressure_mmhg": 8.0},
        **{"strain_exponent": 2.0, "scales_with_pressure": True},
        **{"limitations": "LIMITATIONS.md", "extended": "extended.yaml"},
    }


def diagnosed(path, verdict):
    pd.DataFrame(
        {
            "case": "heart",
            "parameter": PARAMETERS.names,
            **{"rhat": 1.002, "ess_bulk": 900.0, "ess_tail": 801.0, "outside": 0.0},
            **{"passed": verdict == "passed", "verdict": verdict},
        }
    ).to_csv(path, index=False)


def made(given, tmp_path, **changes) -> str:
    """The page as HTML, with other arguments."""
    make_page(**given | changes, page=tmp_path / "page.html")
    return (tmp_path / "page.html").read_text()


def text_of(page: str) -> str:
    """What a reader sees, in single spaces."""
    body = re.sub(r"<(script|style).*?</\1>", " ", page, flags=re.DOTALL)
    body = re.sub(r"</(td|th|li|p|h\d)>", " ", body).replace("&nbsp;", " ")
    return " ".join(re.sub(r"<[^>]+>", "", body).split())


def section(page: str, name: str) -> str:
    return text_of(re.search(rf'<section id="{name}">.*?</section>', page, re.DOTALL).group())


def with_findings(given, tmp_path, **changes) -> dict:
    """Arguments with other findings, whose words are written anew."""
    content = json.loads(given["findings"].read_text())
    content |= changes
    content["words"] = words.verdict(content)
    write_findings(content, tmp_path / "findings.json")
    return given | {"findings": tmp_path / "findings.json"}


@pytest.fixture(scope="module")
def page(given, tmp_path_factory) -> str:
    return made(given, tmp_path_factory.mktemp("made"))


def test_the_page_needs_nothing_but_itself(page):
    outside = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", outside)
    assert not re.search(r"<(link|iframe|object)\b|@import|url\(", outside)
    assert not re.search(r"<script[^>]*\bsrc=", page)
    assert outside.count("data:image/png;base64,") == 5
    order = re.findall(r'<section id="(\w+)"', page)
    assert order == ["measured", "shape", "stiffness", "fit", "wrong", "next", "sure"]


def test_what_was_measured_and_what_was_not(page):
    assert "SYNTHETIC DATA" in page
    shown = section(page, "measured")
    table = measured(ToyEmulator(), basal(), 0.8, seed=5)
    volume = table.loc[table["quantity"] == "volume", "value"].item()
    assert f"the volume {volume:.4g} mL 1" in shown
    assert "circumferential strain 16 of 17" in shown
    assert (
        "Not measured: circumferential strain of segment 17; radial strain of segment 17; "
        "longitudinal strain." in shown
    )
    assert "8 mmHg is assumed and was simulated" in shown
    assert missing(table, CHANNELS) == []


def test_stiffness_says_what_the_data_say(page):
    shown = section(page, "stiffness")
    assert "1 is the reference material" in shown
    assert (
        "In the zone lateral, Ca and Cb compensate each other (correlation of their logarithms -0.9"
        in shown
    )
    assert shown.count("compensate each other") == 1
    assert "The data do not constrain Cb apical:" in shown
    middle = float(torch.sqrt(THETA[4] * THETA[5]))
    mean = re.search(r"geometric mean of the zone's factors is (\d\.\d\d) ", shown).group(1)
    assert float(mean) == pytest.approx(middle, abs=0.02)


def test_what_to_measure_next(page):
    shown = section(page, "next")
    assert "would separate basal motion from twin best" in shown
    assert "The data do not constrain Cb apical; not measured in its zone:" in shown
    # Once, in the section that recommends a measurement.
    assert "would separate" not in section(page, "wrong")


def test_a_group_is_told_as_one_and_nothing_as_nothing(given, page, tmp_path):
    content = json.loads(given["findings"].read_text())
    assert [set(group) for group in content["groups"]] == [{"basal_motion", "twin"}]
    shown = section(page, "wrong")
    assert "is present; the data cannot tell which" in shown
    assert "Bold: changes of more than 1 standard deviation" in shown
    assert "extended.yaml" not in shown  # nothing is named
    quiet = {"misfit": content["misfit"] | {"detected": False}}
    quiet |= dict.fromkeys(("remaining", "best")) | {"groups": [], "separating": []}
    shown = section(made(with_findings(given, tmp_path, **quiet), tmp_path), "wrong")
    assert "The model fits the measurements within their noise" in shown
    assert "No cause was found" in shown and "Nothing: the model stays as it is." in shown


def test_an_unnamed_set_is_not_shown_as_the_answer(given, tmp_path):
    content = {"groups": [], "separating": [], "explained": False, "acts_like": ["basal_motion"]}
    shown = section(made(with_findings(given, tmp_path, **content), tmp_path), "wrong")
    assert "Of the listed causes basal motion" in shown and "not named" in shown
    assert "which is not named: it does not explain the misfit" in shown


def test_a_named_cause_comes_with_the_study_that_has_it(given, tmp_path):
    content = {"groups": [], "separating": [], "named": ["basal_motion"]}
    shown = section(made(with_findings(given, tmp_path, **content), tmp_path), "wrong")
    assert "Named: basal motion" in shown
    assert "snakemake --cores 2 pages --configfile extended.yaml" in shown


def test_a_failed_convergence_check_is_reported_first_and_last(given, page, tmp_path):
    assert 'class="failed"' not in page and "passed its convergence check" in page
    diagnosed(tmp_path / "diagnostics.csv", FAILED)
    failed = made(given, tmp_path, diagnostics=tmp_path / "diagnostics.csv")
    assert failed.count('<p class="failed" role="alert">POSTERIOR FAILED') == 2
    assert "(R-hat 1.600 &gt; 1.01)" in failed
    assert "passed its convergence check" not in failed


def test_what_users_typed_is_text(given, tmp_path):
    bad = "<script>alert(1)</script>"
    content = {"limits": [f"{bad} & more"]}
    changed = with_findings(given, tmp_path, **content) | {"subject": bad, "study": bad}
    html = made(changed, tmp_path)
    assert bad not in html
    assert html.count("&lt;script&gt;alert(1)&lt;/script&gt;") == 4


def test_without_simulator_and_criticism_it_says_so(given, tmp_path):
    absent = ("findings", "residuals_picture", "mesh", "zones_picture")
    html = made(given, tmp_path, **dict.fromkeys(absent), source="file")
    assert "The criticism of the model was not made for this subject." in html
    assert "<script" not in html and "SYNTHETIC" not in html


# ------------------------------------------------------------------------------- in a browser


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Chromium without a window, drawing 3-D in software."""
    programs = {name: shutil.which(name) for name in ("chromium", "chromedriver")}
    absent = [name for name, path in programs.items() if path is None]
    assert not absent, f"no {' and no '.join(absent)}: install envs/debian-packages-test.txt"
    options = webdriver.ChromeOptions()
    options.binary_location = programs["chromium"]
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for flag in (
        *("headless", "no-sandbox", "disable-dev-shm-usage", "disable-quic", "no-first-run"),
        *("use-angle=swiftshader", "enable-unsafe-swiftshader"),
        *("disable-background-networking", "disable-component-update", "disable-sync"),
        *("window-size=1200,900", f"user-data-dir={tmp_path_factory.mktemp('chromium')}"),
    ):
        options.add_argument(f"--{flag}")
    driver = webdriver.Chrome(options, webdriver.ChromeService(programs["chromedriver"]))
    yield driver
    driver.quit()


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
    assert len(widths) == 5 and min(widths) > 300
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


def test_an_emulator_that_was_named_has_its_errors_and_no_coverage(given, tmp_path):
    text = section(made(given, tmp_path, emulator="gradient_gp", choice=None), "sure")
    assert "on 3 simulated" in text and "Of 64 simulated" not in text
    assert "Of 64 simulated" in section(made(given, tmp_path), "sure")
