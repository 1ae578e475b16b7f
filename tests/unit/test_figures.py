"""Figures and tables: they are made, they carry their numbers, and they hide no failure."""

import json

import matplotlib
import meshio
import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot
from matplotlib.path import Path as Outline
from vtkmodules.vtkCommonDataModel import vtkTriQuadraticHexahedron

from regional_lv import aha
from regional_lv.channels import Channels
from regional_lv.config.sections.subjects import Subject
from regional_lv.criticism import case_posterior
from regional_lv.errors import InputError
from regional_lv.inference.posteriors import load, write
from regional_lv.inputs.stiffness import ZONES, StiffnessInputs
from regional_lv.paper.plots import parity, recovery
from regional_lv.paper.tables import posteriors
from regional_lv.plots import (
    bullseye,
    bullseye_posterior,
    criticism,
    design,
    explained_variance,
    heart,
    posterior_predictive,
    style,
    zones,
)
from regional_lv.plots.density import density
from regional_lv.tables import subjects
from tests.criticism.findings_example import example, write_posterior
from tests.drawn import read, table_of

FAILED = "failed: R-hat 1.6 of C_a_septal above 1.01"
PARAMETERS, CHANNELS = StiffnessInputs(), Channels.of()
OBSERVED = [o for o in CHANNELS.names if not o.startswith("longitudinal") and "17" not in o]


@pytest.fixture
def averaged(tmp_path):
    """The posterior of a heart averaged over models, and the findings: (nc, findings)."""

    def make(**changes):
        findings = example(**changes)
        (tmp_path / "findings.json").write_text(json.dumps(findings))
        y, sd = dict.fromkeys(OBSERVED, 0.1), dict.fromkeys(OBSERVED, 0.01)
        write_posterior(findings, y, sd, tmp_path / "averaged.nc")
        return tmp_path / "averaged.nc", tmp_path / "findings.json"

    return make


@pytest.fixture
def test_set(tmp_path):
    """recovery.csv, coverage.csv and diagnostics.csv of three cases, of which one failed."""
    rows = [
        (case, name, 1.0, 1.1, 1.2, 0.1, low, 1.4, low < 1.0, 0.05, 0.01)
        for case, low in (("0", 0.9), ("1", 0.8), ("2", 1.05))
        for name in PARAMETERS.names
    ]
    columns = (
        "case parameter truth map mean sd lower95 upper95 covered95 crps variance_ratio".split()
    )
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "recovery.csv", index=False)
    covered = pd.DataFrame({"parameter": [*PARAMETERS.names, "all"]})
    covered = covered.assign(cases=3, failed=1, bias=0.1, mse=0.01, mean_mse=0.04)
    covered = covered.assign(crps=0.05, variance_ratio=0.01, hpd_width95=0.4)
    for level in (50, 80, 95):
        covered[f"coverage{level}"] = 2 / 3
        covered[f"coverage{level}_lower"] = 0.09
        covered[f"coverage{level}_upper"] = 0.99
    covered.to_csv(tmp_path / "coverage.csv", index=False)
    pd.DataFrame(
        [
            (case, name, rhat, 500.0, 500.0, 0, verdict == "passed", verdict)
            for case, rhat, verdict in (
                ("0", 1.0, "passed"),
                ("1", 1.0, "passed"),
                ("2", 1.3, FAILED),
            )
            for name in PARAMETERS.names
        ],
        columns="case parameter rhat ess_bulk ess_tail divergences passed verdict".split(),
    ).to_csv(tmp_path / "diagnostics.csv", index=False)
    return [tmp_path / f"{name}.csv" for name in ("recovery", "coverage", "diagnostics")]


@pytest.fixture
def choice(tmp_path):
    (tmp_path / "final.json").write_text('{"final": "exact_gp"}')
    return tmp_path / "final.json"


# Bullseye


def test_segment_1_is_at_the_top_and_numbers_run_towards_the_septum():
    centres = np.array([cell.centre for cell in bullseye.SEGMENT_CELLS])
    assert centres[0] == pytest.approx((0, 0.875))
    assert centres[6] == pytest.approx((0, 0.625))
    assert centres[12] == pytest.approx((0, 0.375))
    assert centres[16] == pytest.approx((0, 0))
    septal, lateral = (
        [number - 1 for number in PARAMETERS.zones[zone]] for zone in ("septal", "lateral")
    )
    assert (centres[septal, 0] < 0).all()
    assert (centres[lateral, 0] > 0).all()
    assert centres[3] == pytest.approx((0, -0.875))


def spread_points() -> np.ndarray:
    points = np.random.default_rng(1).uniform(-1, 1, (4000, 2))
    return points[np.hypot(*points.T) < 0.999]


def test_segments_tile_the_disk():
    points, cells = spread_points(), bullseye.SEGMENT_CELLS
    inside = sum(Outline(c.outline()).contains_points(points).astype(int) for c in cells)
    # Borders drawn with straight strokes of one degree may claim or lose a point beside them.
    assert (inside == 1).mean() > 0.998
    area = sum((c.outer**2 - c.inner**2) * np.radians(c.stop - c.start) / 2 for c in cells)
    assert area == pytest.approx(np.pi)
    of = bullseye.segment_at(points)
    for number, cell in enumerate(cells, start=1):
        holds = Outline(cell.outline()).contains_points(points)
        assert ((of == number) == holds).mean() > 0.998


LEVELS = {"basal": range(1, 7), "mid": range(7, 13), "apical": range(13, 18)}
PIECES = {"far": (1, 4, 17), "rest": (2, 3, *range(5, 17))}


@pytest.mark.parametrize("zones", [*ZONES.values(), LEVELS, PIECES])
def test_zones_tile_the_disk_and_hold_their_segments(zones):
    points = spread_points()
    shapes = bullseye.zone_shapes(StiffnessInputs(zones))
    assert sum(shape.holds(points).astype(int) for shape in shapes.values()).min() == 1
    for zone, shape in shapes.items():
        assert shape.holds(np.array([shape.centre])).all()
        for segment, cell in zip(aha.SEGMENTS, bullseye.SEGMENT_CELLS, strict=True):
            assert shape.holds(np.array([cell.centre])) == (segment.number in zones[zone])
        # The area inside the outline, holes taken off: by the shoelace formula of its loops.
        loops = shape.outline.to_polygons()
        area = sum(np.cross(p[:-1], p[1:]).sum() / 2 for p in loops)
        cells = [bullseye.SEGMENT_CELLS[number - 1] for number in zones[zone]]
        exact = sum((c.outer**2 - c.inner**2) * np.radians(c.stop - c.start) / 2 for c in cells)
        assert area == pytest.approx(exact, rel=1e-3)


def test_values_colour_their_own_segment():
    fig = style.figure(3, 3)
    ax = fig.subplots()
    values = np.arange(17.0)
    values[4] = np.nan
    scale = bullseye.paint_values(ax, values, bullseye.Normalize(0, 16), "viridis")
    faces = [patch.get_facecolor() for patch in ax.patches[:17]]
    assert faces[9] == pytest.approx(scale.to_rgba(9.0))
    assert faces[4][:3] == pytest.approx([0xEE / 255] * 3)


# One test per figure: made, and its numbers beside it


def ring_mesh(path):
    """Seventeen quadratic hexahedra in a ring, one per segment, with a facet on each, unmoved."""
    local = np.array(vtkTriQuadraticHexahedron().GetParametricCoords()).reshape(27, 3)
    points = []
    for i in range(17):
        angle = 2 * np.pi * (i + local[:, 0]) / 17
        radius = 35 - 10 * local[:, 1]  # inwards: a right-handed element
        points.append(np.c_[radius * np.cos(angle), radius * np.sin(angle), 60 * local[:, 2] - 60])
    cells = np.arange(17 * 27).reshape(17, 27)
    numbers, points = np.arange(1, 18), np.concatenate(points)
    meshio.Mesh(
        points,
        [("hexahedron27", cells), ("quad9", cells[:, :9])],
        cell_data={"segment": [numbers, numbers * 0]},
        point_data={"displacement": np.zeros_like(points)},
    ).write(path)
    return path


@pytest.fixture
def mesh(tmp_path):
    return ring_mesh(tmp_path / "mesh.vtu")


def test_zones(mesh, paths):
    zones.draw(mesh, PARAMETERS, *paths)
    table = read(paths)
    assert list(table["segment"]) == list(range(1, 18))
    assert list(table["colour"]) == [
        PARAMETERS.colours[PARAMETERS.zone_of(s.number)] for s in aha.SEGMENTS
    ]
    assert (table["elements"] == 1).all()


def test_subdivision_follows_the_curved_element(mesh):
    grid = heart.straight_cells(mesh, 4)
    radius = np.hypot(*grid.points[:, :2].T)
    assert radius.min() == pytest.approx(25, abs=0.01)
    assert radius.max() == pytest.approx(35, abs=0.01)
    volumes = grid.compute_cell_sizes(length=False, area=False).cell_data["Volume"]
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(np.pi * (35**2 - 25**2) * 60, rel=2e-3)


def test_zones_need_segment_numbers(tmp_path, paths):
    meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])]).write(tmp_path / "bare.vtu")
    with pytest.raises(InputError, match=r"bare\.vtu"):
        zones.draw(tmp_path / "bare.vtu", PARAMETERS, *paths)


def simulations(tmp_path, scales):
    rng = np.random.default_rng(2)
    table = pd.DataFrame(rng.normal(size=(len(scales), 52)), columns=list(CHANNELS.names))
    table.insert(0, "scale", scales)
    table.insert(0, "sample", np.arange(len(scales)))
    table.to_parquet(tmp_path / "train.parquet")
    return table


@pytest.mark.parametrize("scales", [["natural"] * 30 + ["log"] * 20, ["natural"] * 5])
def test_design(tmp_path, paths, scales):
    table = simulations(tmp_path, scales)
    lost = pd.DataFrame({"sample": [99], "scale": ["natural"], "reason": ["no"]})
    lost = lost.assign(**{name: 1.325 for name in PARAMETERS.names})
    lost = lost.assign(**{f"place_{name}": 0.25 for name in PARAMETERS.names})
    lost.to_csv(tmp_path / "excluded.csv", index=False)
    files = tmp_path / "train.parquet", tmp_path / "excluded.csv"
    design.draw(*files, PARAMETERS, CHANNELS, *paths)
    drawn = read(paths)
    counts = drawn[(drawn["panel"] == "volume") & (drawn["scale"] == "natural")]["value"]
    assert counts.sum() == scales.count("natural")
    median = drawn[
        (drawn["item"] == "radial_05")
        & (drawn["scale"] == "natural")
        & (drawn["statistic"] == "median")
    ]["value"].item()
    natural = table.loc[table["scale"] == "natural", "radial_05"]
    assert median == pytest.approx(natural.median())
    excluded = drawn[drawn["panel"] == "excluded"]
    assert len(excluded) == 10 and (excluded["value"] == 0.25).all()


def test_design_without_failures_says_so(tmp_path, paths, figures):
    simulations(tmp_path, ["natural"] * 5)
    lost = pd.DataFrame(columns=["sample", "scale", *(f"place_{n}" for n in PARAMETERS.names)])
    lost.to_csv(tmp_path / "excluded.csv", index=False)
    files = tmp_path / "train.parquet", tmp_path / "excluded.csv"
    design.draw(*files, PARAMETERS, CHANNELS, *paths)
    texts = [t.get_text() for ax in figures[0].axes for t in ax.texts]
    assert "every simulation converged" in texts


def test_explained_variance(tmp_path, paths, figures):
    explained = np.array([0.9, 0.0985, 0.001, 0.0005])
    table = {"component": [1, 2, 3, 4], "explained": explained, "cumulative": explained.cumsum()}
    pd.DataFrame(table | {"kept": [True, True, True, False]}).to_csv(
        tmp_path / "explained.csv", index=False
    )
    explained_variance.draw(tmp_path / "explained.csv", *paths)
    assert list(read(paths)["kept"]) == [True, True, True, False]
    assert figures[0].get_suptitle().startswith("3 of 4 components")


def test_parity(tmp_path, choice, paths):
    table = pd.DataFrame(
        [(case, o, 1.0, 1.0 + 0.1 * case, 0.1) for case in (0, 1, 3) for o in CHANNELS.names],
        columns=["case", "output", "truth", "mean", "sd"],
    )
    table.to_parquet(tmp_path / "test.parquet")
    parity.draw(tmp_path / "test.parquet", choice, PARAMETERS, *paths)
    drawn = read(paths).groupby("quantity")[["rmse", "coverage95"]].first()
    assert len(drawn) == 4
    # Errors 0, 1 and 3 standard deviations of 0.1: the last lies outside its bar.
    assert drawn["rmse"].to_numpy() == pytest.approx(0.1 * np.sqrt(10 / 3))
    assert drawn["coverage95"].to_numpy() == pytest.approx(2 / 3)


def test_recovery(test_set, choice, paths, figures):
    recovery.draw(*test_set, choice, PARAMETERS, *paths)
    drawn = read(paths)
    cases = drawn[drawn["panel"] == "recovery"]
    assert list(cases.groupby("case")["failed"].first()) == [False, False, True]
    assert (drawn["panel"] == "coverage").sum() == 11
    assert "1 OF 3 POSTERIORS FAILED" in figures[0].get_suptitle()


def test_bullseye_of_an_average_has_the_model_as_it_is_beside_it(averaged, paths, tmp_path):
    nc, findings = averaged(noise=[{"quantity": "radial", "before": 1.6, "after": 0.9}])
    truth = tmp_path / "truth.json"
    truth.write_text(json.dumps({"theta": dict.fromkeys(PARAMETERS.names, 1.2)}))
    bullseye_posterior.draw(nc, findings, "file", PARAMETERS, *paths, truth)
    drawn = read(paths).set_index(["parameter", "item"])["value"].sort_index()
    for row in json.loads(findings.read_text())["stiffness"]:
        name = row["name"]
        for prefix, stated in (("", row["averaged"]), ("as_is_", row["as_it_is"])):
            assert drawn[name, f"{prefix}mean"].item() == pytest.approx(stated["mean"])
            assert drawn[name, f"{prefix}sd"].item() == pytest.approx(stated["sd"])
            low, high = stated["interval95"]
            assert drawn[name, f"{prefix}lower95"].item() == pytest.approx(low)
            curve = drawn[name, f"{prefix}density"]
            assert low < curve.mean() < high
        assert drawn[name, "truth"].item() == 1.2
    assert drawn["sigma_radial", "mean"].item() == pytest.approx(0.9, rel=0.05)
    assert drawn["sigma_radial", "as_is_mean"].item() == pytest.approx(1.6, rel=0.05)


def test_figures_of_a_heart_that_no_model_fits_say_so(averaged, paths, figures):
    nc, findings = averaged(trusted=False)
    bullseye_posterior.draw(nc, findings, "file", PARAMETERS, *paths)
    posterior_predictive.draw(nc, findings, "file", *paths)
    for figure in figures:
        assert "NO STIFFNESS CAN BE TRUSTED" in " ".join(figure.get_suptitle().split())
    assert set(read(paths)["verdict"]) == {case_posterior.UNTRUSTED}


def test_posterior_predictive_of_an_average(averaged, paths, figures):
    nc, findings = averaged()
    posterior_predictive.draw(nc, findings, "file", *paths)
    drawn = read(paths)
    assert sorted(drawn.loc[drawn["item"] == "observed", "output"]) == sorted(OBSERVED)
    assert f"0 of {len(OBSERVED)} observations outside" in figures[0].get_suptitle()


def test_an_average_and_findings_that_do_not_go_together_are_named(averaged, tmp_path):
    nc, findings = averaged()
    groups = load(nc)
    del groups["as_it_is"]
    write(groups, tmp_path / "heart.nc")
    with pytest.raises(InputError, match=r"heart\.nc: no group `as_it_is`; give the posterior"):
        case_posterior.read_averaged(tmp_path / "heart.nc", findings)
    content = json.loads(findings.read_text())
    content["stiffness"][0]["name"] = "C_a_elsewhere"
    findings.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"averaged\.nc: no draws of C_a_elsewhere"):
        case_posterior.read_averaged(nc, findings)


# What a criticism found


def draw_criticism(findings, tmp_path) -> dict[str, pd.DataFrame]:
    """The tables beside the figures, once these have been seen to hold more than paper."""
    (tmp_path / "findings.json").write_text(json.dumps(findings))
    names = ("residuals", "causes", "effects", "sources")
    pngs = {name: tmp_path / f"{name}.png" for name in names}
    tables = [tmp_path / f"{name}.csv" for name in names]
    criticism.draw(tmp_path / "findings.json", PARAMETERS, **pngs, tables=tables)
    return {name: read((pngs[name], tmp_path / f"{name}.csv")) for name in names}


def test_criticism(tmp_path, figures):
    findings = example()
    drawn = draw_criticism(findings, tmp_path)
    z = drawn["residuals"].set_index(["when", "output"])["z"]
    for when, part in (("before", findings["misfit"]), ("after", findings["remaining"])):
        for row in part["channels"]:
            assert z[when, row["output"]] == pytest.approx(row["z"])
    causes = drawn["causes"].set_index("name")
    for h in findings["hypotheses"]:
        assert causes.loc[h["name"], "probability"] == pytest.approx(h["probability"])
    assert causes.loc["septal_load", "estimate"] == pytest.approx(2.1)
    assert set(drawn["effects"]["name"]) == {"septal_load", "focal_scar", "fibre_rotation"}
    shares = drawn["sources"].pivot(index="parameter", columns="source", values="share")
    assert list(shares.sum(axis=1)) == pytest.approx([1.0] * len(PARAMETERS))
    assert shares["geometry"].to_numpy() == pytest.approx(0.17)  # of 17 segments
    assert shares["pressure"].to_numpy() == pytest.approx(0.13)
    texts = [legend.get_text() for legend in figures[1].legends[0].get_texts()]
    assert texts == ["named", "not named", "not identifiable"]


def test_criticism_of_a_model_that_nothing_was_suspected_of(tmp_path):
    nothing = {"hypotheses": [], "sets": [], "named": [], "best": None, "remaining": None}
    drawn = draw_criticism(example(**nothing), tmp_path)
    assert set(drawn["residuals"]["when"]) == {"before"}
    assert drawn["causes"].empty and drawn["effects"].empty


def test_what_is_not_confirmed_is_drawn_as_suspected(tmp_path, figures):
    found = example()
    criticism.draw_causes(
        {**found, "sets": [{**found["sets"][0], "confirmed": False}]},
        *(tmp_path / name for name in ("one.png", "one.csv")),
    )
    assert figures[0].legends[0].get_texts()[0].get_text() == "suspected"


# What no figure of a subject may hide


@pytest.mark.parametrize("source", ["synthetic", "file"])
def test_title_says_where_the_data_come_from(source, averaged, paths, figures):
    nc, findings = averaged()
    bullseye_posterior.draw(nc, findings, source, PARAMETERS, *paths)
    posterior_predictive.draw(nc, findings, source, *paths)
    for figure in figures:
        title = figure.get_suptitle()
        assert case_posterior.SOURCES[source] in title
        assert ("synthetic" in title) == (source == "synthetic")
        assert "TRUSTED" not in title


def test_every_source_of_a_subject_has_a_name():
    assert set(case_posterior.SOURCES) == set(Subject.all_tags())


def test_the_same_figure_is_the_same_file(averaged, tmp_path):
    nc, findings = averaged()
    both = []
    for name in ("a", "b"):
        files = tmp_path / f"{name}.png", tmp_path / "c"
        bullseye_posterior.draw(nc, findings, "file", PARAMETERS, *files)
        both.append((tmp_path / f"{name}.png").read_bytes())
    assert both[0] == both[1]


def test_drawing_leaves_no_global_state(averaged, paths):
    """seaborn imports pyplot, which would keep figures, and its themes are global."""
    before = dict(matplotlib.rcParams)
    nc, findings = averaged()
    posterior_predictive.draw(nc, findings, "file", *paths)
    assert not pyplot.get_fignums()
    assert dict(matplotlib.rcParams) == before


def test_violins_have_the_density_of_the_table(averaged, paths, figures):
    nc, findings = averaged()
    posterior_predictive.draw(nc, findings, "file", *paths)
    drawn = read(paths)
    violins = [c for ax in figures[0].axes for c in ax.collections]
    assert len(violins) == len(OBSERVED)
    first = drawn[(drawn["item"] == "density") & (drawn["output"] == "circumferential_01")]
    x, y = violins[0].get_paths()[0].vertices.T
    heights = first["density"] / first["density"].max()
    grid = slice(1, len(first) + 1)
    assert y[grid] == pytest.approx(first["value"].to_numpy())
    assert -x[grid] / posterior_predictive.WIDTH * 2 == pytest.approx(heights.to_numpy(), abs=1e-6)


def test_intervals_of_predictions_hold_95_of_100_draws(averaged, paths):
    nc, findings = averaged()
    posterior_predictive.draw(nc, findings, "file", *paths)
    ends = read(paths).pivot_table("value", "output", "item")[["lower95", "upper95"]]
    predicted, _ = case_posterior.read_averaged(nc, findings).prediction
    assert sorted(ends.index) == sorted(OBSERVED)
    for output, (low, high) in ends.iterrows():
        draws = predicted.sel(output=output).to_numpy()
        assert ((draws >= low) & (draws <= high)).mean() == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize("groups", ["a", "ab"])
def test_intervals_have_the_given_ends(groups):
    table = pd.DataFrame({"at": list("xy"), "value": [2.0, 5.0], "low": [1.0, 1.5], "high": 6.0})
    table = pd.concat([table.assign(group=group) for group in groups])
    ax = style.figure(3, 3).subplots()
    style.intervals(ax, table, "at", "value", ("low", "high"), hue="group", dodge=0.3)
    ends = [tuple(line.get_ydata()) for line in ax.lines if len(line.get_xdata()) == 2]
    assert [e for e in ends if e != (2.0, 5.0)] == [(1.0, 6.0), (1.5, 6.0)] * len(groups)
    assert ends.count((2.0, 5.0)) == len(groups)


def test_a_bullseye_has_one_axis_of_values():
    shapes = bullseye.zone_shapes(PARAMETERS).values()
    own = [bullseye_posterior._layout(shape, 2, inches=4.2) for shape in shapes]
    alike = bullseye_posterior._alike(own, 2)
    assert len({(place.half, place.height) for place in alike}) == 1
    for place, before in zip(alike, own, strict=True):
        assert place.half <= before.half and place.height <= before.height
        assert place.y - place.height == pytest.approx(before.y - before.height)


def test_draws_that_repeat_are_no_peaks():
    """A hundred, each forty times, have the density of a normal distribution."""
    few = np.repeat(np.random.default_rng(3).normal(size=100), 40)
    values, heights = density(few)
    rises = np.diff(np.sign(np.diff(heights))) < 0
    assert rises.sum() <= 3
    assert (heights.sum() * (values[1] - values[0])) == pytest.approx(1.0, abs=0.03)


def test_constant_draws_have_a_density():
    values, heights = density(np.full((2, 10), 1.5))
    assert values[heights.argmax()] == 1.5


# Tables


def test_table_of_diagnostics(test_set, tmp_path):
    test = tmp_path / "final" / "test" / "diagnostics.csv"
    test.parent.mkdir(parents=True)
    test.write_bytes(test_set[2].read_bytes())
    own = pd.DataFrame({"parameter": [*PARAMETERS.names, "sigma_radial"], "verdict": FAILED})
    numbers = {"rhat": 1.0, "ess_bulk": 900.0, "ess_tail": 800.0, "divergences": 1, "passed": False}
    own.assign(case="heart", **numbers).to_csv(tmp_path / "heart.csv", index=False)
    table = table_of(posteriors.diagnostics, tmp_path, [test], [], [tmp_path / "heart.csv"])
    table = table.set_index(["posterior", "parameter"])
    row = table.loc["test, final", "C_a_septal"]
    assert (row["cases"], row["failed_cases"], row["rhat_max"]) == (3, 1, 1.3)
    assert row["rhat_mean"] == pytest.approx(1.1)
    assert row["rhat_median"] == 1.0
    assert table.loc[("heart", "sigma_radial"), "verdict"] == FAILED


def test_table_of_subjects_averaged_over_models(averaged, tmp_path):
    nc, findings = averaged(trusted=False)
    table = table_of(subjects.subjects, tmp_path, [nc], [findings], ["file"])
    stated = json.loads(findings.read_text())["stiffness"]
    assert list(table["parameter"]) == [row["name"] for row in stated]
    assert list(table["mean"]) == pytest.approx([row["averaged"]["mean"] for row in stated])
    assert list(table["as_is_mean"]) == pytest.approx([row["as_it_is"]["mean"] for row in stated])
    assert list(table["as_is_upper95"]) == pytest.approx(
        [row["as_it_is"]["interval95"][1] for row in stated]
    )
    assert set(table["verdict"]) == {case_posterior.UNTRUSTED}


def test_table_of_recovery(test_set, tmp_path):
    table = table_of(posteriors.recovery, tmp_path, test_set[1]).set_index("parameter")
    assert list(table.index) == [*PARAMETERS.names, "all"]
    assert table["map_mse"].to_numpy() == pytest.approx(0.01)
    assert table["mean_mse"].to_numpy() == pytest.approx(0.04)
    assert set(table["failed_cases"]) == {1}
    assert table.loc["all", "coverage95"] == pytest.approx(2 / 3)
