"""Meshes from elsewhere: imported with tags and surfaces, refused with reasons, meshed anew."""

import json
import re
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest

from regional_lv import aha
from regional_lv import config as study_config
from regional_lv.data import published
from regional_lv.errors import InputError
from regional_lv.geometry.abaqus import read_abaqus
from regional_lv.geometry.comparison import surface_distances
from regional_lv.geometry.elements import exterior_faces, facet_cells
from regional_lv.geometry.from_config import make_heart
from regional_lv.geometry.from_mesh import keep_mesh, remesh, write_imported
from regional_lv.geometry.imported import import_mesh
from regional_lv.geometry.make import make_mesh
from regional_lv.geometry.mesh import BASE, ENDOCARDIUM, EPICARDIUM, read_mesh
from regional_lv.geometry.segment_tags import read_segment_tags
from regional_lv.geometry.shape import NodePlaces
from regional_lv.geometry.summary import cavity_volume, segment_volumes
from regional_lv.geometry.table import read_segments
from regional_lv.geometry.thickness import thickened
from regional_lv.hearts.reach import by_table
from regional_lv.inputs.physics import physics_of
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.mechanics.continuation import Effort, Solver
from regional_lv.mechanics.simulator import Simulator
from regional_lv.page import heart3d
from regional_lv.plots.heart import straight_cells
from regional_lv.study.layout import HeartFiles

ROWS = {
    "circumferential": 16,
    "basal": 1,
    "basal_grading": 1.0,
    "mid": 2,
    "apical": 1,
    "apex": 1,
    "transmural": 1,
}
FINE = {
    "circumferential": 32,
    "basal": 2,
    "basal_grading": 1.0,
    "mid": 5,
    "apical": 3,
    "apex": 4,
    "transmural": 1,
}
ANEW = {
    "circumferential": 24,
    "basal": 1,
    "basal_grading": 1.0,
    "mid": 2,
    "apical": 1,
    "apex": 2,
    "transmural": 1,
}


def make(folder, config, rows):
    """The default heart, quadratic, with these rows of elements."""
    geometry = config["geometry"]
    make_mesh(
        geometry["segments"],
        geometry["endo_apex_z_mm"],
        geometry["epi_apex_z_mm"],
        rows,
        config["fibres"],
        *(folder / name for name in ("mesh.msh", "mesh.vtu", "segments.csv", "summary.json")),
    )
    return read_mesh(folder / "mesh.vtu")


def corners_of(mesh):
    """Points (n, 3), cells (m, 8) and segment (m,) of a quadratic mesh's linear hexahedra."""
    used, cells = np.unique(mesh.cells[:, :8], return_inverse=True)
    return mesh.points[used], cells.reshape(-1, 8), mesh.segment


@pytest.fixture(scope="module")
def quadratic(tmp_path_factory, smoke_config):
    return make(tmp_path_factory.mktemp("quadratic"), smoke_config, ROWS)


@pytest.fixture(scope="module")
def heart(quadratic):
    return corners_of(quadratic)


def save(path, points, cells, segment=None):
    """The mesh as .vtu, with the segments as cell data if there are any."""
    data = {} if segment is None else {"segment": [segment]}
    meshio.Mesh(points, [("hexahedron", cells)], cell_data=data).write(path)
    return path


def save_abaqus(folder, points, cells, segment, numbers, surfaces=""):
    """The mesh as .inp with these element numbers, and a CSV of its segments."""
    lines = ["*Heading", "*Part, name=PART-1", "*Node"]
    lines += [f"{i}, {x:.9f}, {y:.9f}, {z:.9f}" for i, (x, y, z) in enumerate(points, 1)]
    lines += ["*Element, type=C3D8H"]
    lines += [", ".join(map(str, (n, *(cell + 1)))) for n, cell in zip(numbers, cells, strict=True)]
    lines += [surfaces, "*INCLUDE,INPUT=fibres_that_are_not_there.inp", "*End Part"]
    (folder / "heart.inp").write_text("\n".join(lines) + "\n")
    table = pd.DataFrame({"element": numbers, "aha_segment": segment})
    table.sample(frac=1, random_state=1).to_csv(folder / "segments.csv", index=False)
    return folder / "heart.inp", folder / "segments.csv"


@pytest.fixture(scope="module")
def imported(tmp_path_factory, heart):
    return import_mesh(save(tmp_path_factory.mktemp("vtu") / "heart.vtu", *heart))


# --- what is imported ------------------------------------------------------------------------


def test_cells_tags_and_surfaces(imported, quadratic, heart):
    points, cells, segment = heart
    np.testing.assert_allclose(imported.points, points)
    np.testing.assert_array_equal(imported.cells, cells)
    np.testing.assert_array_equal(imported.segment, segment)
    for surface in (ENDOCARDIUM, EPICARDIUM, BASE):
        assert (imported.surface == surface).sum() == (quadratic.surface == surface).sum()
        corners = quadratic.points[quadratic.facets[quadratic.surface == surface][:, :4]]
        mine = imported.points[imported.facets[imported.surface == surface]]
        np.testing.assert_allclose(
            np.unique(np.round(corners.reshape(-1, 3), 6), axis=0),
            np.unique(np.round(mine.reshape(-1, 3), 6), axis=0),
            atol=1e-5,
        )
    assert cavity_volume(imported) == pytest.approx(cavity_volume(quadratic), rel=0.06)
    np.testing.assert_array_equal(facet_cells(imported), exterior_faces(imported.cells)[1])


def test_depth_is_even_and_smooth(imported, quadratic):
    # The mesh was made with layers of equal thickness, whose depth is known.
    used = np.unique(quadratic.cells[:, :8])
    assert np.abs(imported.transmural - quadratic.transmural[used]).max() < 0.05
    assert imported.transmural.min() == 0
    assert imported.transmural.max() == 1
    assert imported.longitudinal.max() == pytest.approx(1)
    assert imported.longitudinal.min() < 0.05


def test_abaqus_with_numbers_of_its_own(tmp_path, heart, imported):
    points, cells, segment = heart
    numbers = np.arange(len(cells))[::-1] * 3 + 11
    mesh = import_mesh(*save_abaqus(tmp_path, points, cells, segment, numbers))
    np.testing.assert_array_equal(mesh.segment, segment)
    np.testing.assert_array_equal(mesh.surface, imported.surface)
    np.testing.assert_allclose(mesh.transmural, imported.transmural, atol=1e-6)


def test_named_abaqus_surfaces_are_used(tmp_path, heart, imported):
    points, cells, segment = heart
    numbers = np.arange(1, len(cells) + 1)
    abaqus_faces = [
        (0, 1, 2, 3),
        (4, 7, 6, 5),
        (0, 4, 5, 1),
        (1, 5, 6, 2),
        (2, 6, 7, 3),
        (3, 7, 4, 0),
    ]
    names = {ENDOCARDIUM: "Endocardium", EPICARDIUM: "epi", BASE: "BaseSurf"}
    owner, text = facet_cells(imported), []
    for surface, name in names.items():
        text.append(f"*Surface, type=ELEMENT, name={name}")
        for k in np.flatnonzero(imported.surface == surface):
            nodes = set(imported.facets[k])
            face = next(
                i for i, f in enumerate(abaqus_faces, 1) if set(cells[owner[k]][list(f)]) == nodes
            )
            text.append(f"{numbers[owner[k]]}, S{face}")
    mesh = import_mesh(*save_abaqus(tmp_path, points, cells, segment, numbers, "\n".join(text)))
    np.testing.assert_array_equal(mesh.surface, imported.surface)
    # A surface that misses facets is refused and not patched up.
    short = "\n".join(text[:-3])
    with pytest.raises(InputError, match="surfaces of endocardium, epicardium and base name"):
        import_mesh(*save_abaqus(tmp_path, points, cells, segment, numbers, short))


def in_blocks(text):
    """Every node and every element below a keyword of its own."""
    lines, keyword = [], ""
    for line in text.splitlines():
        if line.startswith("*"):
            keyword = line
        elif keyword.startswith(("*Node", "*Element")):
            lines.append(keyword)
        lines.append(line)
    return "\n".join(lines)


ABAQUS = {
    "blocks": in_blocks,
    "elements_before_nodes": lambda text: "*Element{1}\n*Node{0}\n*End Part\n".format(
        *re.search(r"\*Node(.*)\n\*Element(.*?)\n\n", text, re.DOTALL).groups()
    ),
    "lower_case": str.lower,
    "upper_case": str.upper,
    "continued": lambda text: text.replace("*Element, type", "*Element,\n type"),
    "latin_1": lambda text: text.replace("*Node", "** M\xfcller \x85 1\n*Node").encode("latin-1"),
    "utf_8_with_mark": lambda text: text.replace("*Node", "** M\xfcller\n*Node").encode(
        "utf-8-sig"
    ),
    "utf_16": lambda text: text.encode("utf-16"),
    "windows": lambda text: text.replace("\n", "\r\n"),
    "long_elements": lambda text: re.sub(r"(?m)^((\d+, ){4}\d+), (?=\d)", r"\1,\n ", text),
    "fortran": lambda text: re.sub(r"(?m)(\.\d+)(?=,|$)", r"\1D+00", text),
    "a_point_of_the_assembly": lambda text: text + "*Assembly\n*Node\n1, 0., 0., 0.\n",
}


@pytest.mark.parametrize("variant", ABAQUS)
def test_variants_of_abaqus(variant, tmp_path, heart, imported):
    points, cells, segment = heart
    path, tags = save_abaqus(tmp_path, points, cells, segment, np.arange(5, len(cells) + 5))
    text = ABAQUS[variant](path.read_text())
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    mesh = import_mesh(path, tags)
    np.testing.assert_array_equal(mesh.segment, segment)
    np.testing.assert_array_equal(mesh.cells, imported.cells)
    np.testing.assert_allclose(mesh.points, imported.points, atol=1e-6)


def test_sets_and_included_files_of_abaqus(tmp_path):
    """Two bricks, one on top of the other, of two blocks and of files that are included."""
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    nodes = [
        f"{4 * z + i + 1}, {x}, {y}, {z}" for z in range(3) for i, (x, y) in enumerate(corners)
    ]
    (tmp_path / "nodes.txt").write_text("\n".join(nodes[4:]))
    (tmp_path / "sets.inp").write_text("*Elset, elset=Both, generate\n 7, 9, 2\n")
    path = tmp_path / "bricks.inp"
    path.write_text(
        "\n".join(
            [
                *("*Node", *nodes[:4], "*Node, input=nodes.txt", "*Include, input=sets.inp"),
                *("*Element, type=C3D8, elset=Low", "7, 1, 2, 3, 4, 5, 6, 7, 8"),
                *("*Element, type=C3D8R", "9, 5, 6, 7, 8, 9, 10, 11, 12"),
                *("*Elset, elset=HIGH", "9", "*Elset, elset=nested", "low, HIGH"),
                *('*Surface, name="side"', "nested, S3", "*Surface, name=top", "Part-1.9, S2"),
                *("*Surface, name=left", "both, S6", "*Surface, type=NODE, name=n", "1, 1.", ""),
                *("*Surface, name=Top of all", "high,", "*Surface, name=shell", "low, SPOS"),
            ]
        )
    )
    mesh, numbers, surfaces = read_abaqus(path, ["side", "top", "left"])
    free = surfaces.pop("Top of all")
    assert len(free) == 5 and not (np.sort(free) == [4, 5, 6, 7]).all(axis=1).any()
    assert numbers.tolist() == [7, 9] and mesh.points[11].tolist() == [0, 1, 2]
    assert {name: np.sort(facets).tolist() for name, facets in surfaces.items()} == {
        "side": [[0, 1, 4, 5], [4, 5, 8, 9]],
        "top": [[8, 9, 10, 11]],
        "left": [[0, 3, 4, 7], [4, 7, 8, 11]],
    }


@pytest.mark.parametrize(
    "old, new, says",
    [
        ("type=C3D8H", "type=C3D4", "holds elements of type C3D4; leave eight-node bricks"),
        ("*Element, type=C3D8H", "*Nset, nset=a", "holds no elements; give one part"),
        ("type=C3D8H\n5,", "type=C3D8H\n6,", "two elements have the same number"),
        ("*Node\n1, ", "*Node\n999999, ", "an element has the node 1, which is not there"),
        ("*End Part", "*Surface, name=Endo\nb, S1", "names the element set b, which is not there"),
        (
            "*End Part",
            "*Surface, name=Epi\n5, SPOS",
            "row '5, SPOS': SPOS is no face of a brick",
        ),
        ("*End Part", "*Surface, name=base\n4", r"base, row '4': has no element 4; .* S1 to S6"),
        ("*End Part", "*Instance, name=a\n0., 0., -10.", "moves the instance a in the assembly"),
        ("*End Part", "*Node, input=none.txt", "none.txt: there is no such file"),
    ],
)
def test_abaqus_that_is_refused(old, new, says, tmp_path, heart):
    numbers = np.arange(5, len(heart[1]) + 5)
    path, tags = save_abaqus(tmp_path, *heart, numbers)
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=says):
        import_mesh(path, tags)


def test_segments_of_several_numbers_are_refused(tmp_path, heart):
    points, cells, segment = heart
    path = save(tmp_path / "heart.vtu", points, cells, np.repeat(segment[:, None], 3, axis=1))
    with pytest.raises(InputError, match=f"has {3 * len(cells)} numbers for {len(cells)} elements"):
        import_mesh(path)


def test_published_labels_become_aha_numbers(tmp_path):
    from scipy.io import savemat

    labels = np.array([1, 2, 3, 13, 14, 17, 6], dtype=np.uint8)
    savemat(tmp_path / "tags.mat", {"AHALVMeshDivision": {"elRegions": labels}})
    tags = read_segment_tags(tmp_path / "tags.mat", np.arange(1, 8))
    order = {s.published_order: s.number for s in aha.SEGMENTS}
    assert tags.tolist() == [order[label] for label in labels]
    with pytest.raises(InputError, match="labels 7 elements but the mesh has 5"):
        read_segment_tags(tmp_path / "tags.mat", np.arange(5))


def test_base_that_is_flat_but_for_round_off(tmp_path, heart, imported, smoke_config):
    """Its nodes are held and its rim is closed as if it were flat, and it is made so."""
    points, cells, segment = heart
    rough = points.copy()
    on_base = points[:, 2] > -1e-6
    rough[on_base, 2] = np.random.default_rng(1).uniform(-2e-2, 2e-2, on_base.sum())
    found = import_mesh(save(tmp_path / "rough.vtu", rough, cells, segment))
    np.testing.assert_allclose(found.points, imported.points)
    found.points[on_base, 2] = rough[on_base, 2]
    physics = physics_of(smoke_config)
    held = [Simulator(mesh, physics) for mesh in (imported, found)]
    assert [len(one.fixed) for one in held] == [len(held[0].fixed)] * 2
    assert len(held[0].fixed) > 2 * len(imported.nodes_on(ENDOCARDIUM, BASE))
    for one in held:
        np.testing.assert_array_equal(
            one.observer.cavity.nodes[one.observer.cavity.ring],
            imported.nodes_on(ENDOCARDIUM, BASE),
        )


def test_unit_is_converted(tmp_path, heart, imported):
    points, cells, segment = heart
    mesh = import_mesh(save(tmp_path / "m.vtu", points / 1000, cells, segment), unit="m")
    np.testing.assert_allclose(mesh.points, imported.points, atol=1e-9)


def test_file_of_a_linear_mesh(tmp_path, heart, smoke_config):
    source = save(tmp_path / "heart.vtu", *heart)
    write_imported(source, "mm", smoke_config["fibres"], tmp_path / "imported.vtu")
    names = [tmp_path / name for name in ("mesh.vtu", "segments.csv", "summary.json")]
    keep_mesh(tmp_path / "imported.vtu", smoke_config["fibres"], *names)
    mesh = read_mesh(names[0])
    assert mesh.cells.shape[1] == 8
    assert mesh.facets.shape[1] == 4
    fibres = meshio.read(names[0]).point_data["fibre"]
    np.testing.assert_allclose(np.linalg.norm(fibres, axis=1), 1)
    table, summary = pd.read_csv(names[1]), json.loads(names[2].read_text())
    assert table["volume_ml"].sum() == pytest.approx(summary["wall_volume_ml"], rel=1e-5)
    assert table["elements"].sum() == summary["elements"] == len(mesh.cells)
    # Figures and pages show it as it is, and a finer division fills the same space.
    whole, parts = straight_cells(names[0], 3), straight_cells(names[0], 3, linear=2)
    assert (whole.n_cells, parts.n_cells) == (len(mesh.cells), 8 * len(mesh.cells))
    assert parts.volume == pytest.approx(whole.volume, rel=0.01)
    assert whole.cell_data["segment"].tolist() == mesh.segment.tolist()
    parameters = StiffnessInputs.from_config(smoke_config)
    medians = dict.fromkeys(parameters.names, 1.0)
    div = heart3d.draw(names[0], parameters, medians, ["a segment"] * 17)
    assert div.count('"hovertemplate":"a segment') == 17


def test_only_a_wall_that_changes_needs_columns_of_cells(imported):
    """Here, some lines of cells from the epicardium end on no endocardium."""
    surface = imported.surface.copy()
    surface[np.flatnonzero(surface == ENDOCARDIUM)[:3]] = BASE
    mesh, shape = replace(imported, surface=surface), {"wall_thickness_scale": 1.0}
    places = NodePlaces(mesh, shape)
    assert thickened(mesh, 1.0) is mesh
    with pytest.raises(InputError, match=r"^geometry.wall_thickness_scale: .*remesh: true"):
        thickened(mesh, 1.1)
    with pytest.raises(InputError, match=r"^inputs .* no columns of cells .*remesh: true"):
        places.moves(shape, ())


# --- what is refused -------------------------------------------------------------------------


def swapped(points, cells, segment):
    cells = cells.copy()
    cells[6] = cells[6][[4, 5, 6, 7, 0, 1, 2, 3]]
    return points, cells, segment


def flattened(points, cells, segment):
    cells = cells.copy()
    cells[[3, 8], 1] = cells[[3, 8], 0]
    return points, cells, segment


def retagged(old, new):
    def change(points, cells, segment):
        return points, cells, np.where(segment == old, new, segment)

    return change


def renumbered(**new):
    """Tags changed from the first to the second number: _1=7 makes segment 1 number 7."""

    def change(points, cells, segment):
        numbers = {int(old[1:]): number for old, number in new.items()}
        return points, cells, np.array([numbers.get(s, s) for s in segment.tolist()])

    return change


def moved(shift):
    return lambda points, cells, segment: (points + shift, cells, segment)


def scaled(factor):
    return lambda points, cells, segment: (points * factor, cells, segment)


def torn(points, cells, segment):
    return points, cells[segment != 17], segment[segment != 17]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (scaled(0.001), "looks like one in metres, set geometry.imported.unit to m"),
        (scaled(0.1), "looks like one in centimetres, set geometry.imported.unit to cm"),
        (scaled(5), "between 30 and 200 are possible"),
        (swapped, "element 7 inverted; correct"),
        (flattened, "elements 4, 9 degenerate"),
        (lambda p, c, s: (p, c[:, [4, 5, 6, 7, 0, 1, 2, 3]], s), "every element is inside out"),
        (lambda p, c, s: (p, c, None), "has no cell data `segment`"),
        (retagged(5, 18), "without an AHA segment from 1 to 17"),
        (retagged(5, 4), "segment 5 has no element; tag"),
        (torn, "segment 17 has no element"),
        (moved([0, 0, 7]), "at z = 7 mm; the base must be the plane z = 0"),
        (moved([60, 0, 0]), "the z axis does not run through the cavity"),
        (
            renumbered(_1=7, _7=1),
            "that of segment 7 (mid anterior) is at z = -7 mm; correct the tags: levels go from",
        ),
        (
            renumbered(_2=6, _6=2, _3=5, _5=3),
            "seen from the base, segment 1 of the basal level is followed by 6 at ",
        ),
        (
            renumbered(_7=8, _8=9, _9=10, _10=11, _11=12, _12=7),
            "at the mid level the middle of the septum (segments 8 and 9) is 60 degrees away",
        ),
    ],
)
def test_bad_mesh(change, message, tmp_path, heart):
    path = save(tmp_path / "heart.vtu", *change(*heart))
    with pytest.raises(InputError) as error:
        import_mesh(path)
    assert str(path) in str(error.value)
    assert message in str(error.value)


def test_hole_in_the_apex(tmp_path, heart):
    points, cells, segment = heart
    low = (np.hypot(*points[cells][..., :2].T) < 1e-6).any(axis=0)
    path = save(tmp_path / "heart.vtu", points, cells[~low], segment[~low])
    with pytest.raises(InputError, match="the exterior falls into 1 pieces"):
        import_mesh(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[t["element"] != 4], "element 4 without an AHA segment"),
        (lambda t: pd.concat([t, t[t["element"] == 4]]), "element 4 was given before"),
        (lambda t: t.assign(element=t["element"] + 1), "the mesh has no element"),
        (lambda t: t.assign(aha_segment=1.5), "line 2: aha_segment is 1.5; give a whole number"),
        (
            lambda t: t.rename(columns={"aha_segment": "segment"}),
            "line 1: no column `aha_segment`; rename `segment`",
        ),
    ],
)
def test_bad_table_of_segments(change, message, tmp_path, heart):
    numbers = np.arange(1, len(heart[1]) + 1)
    mesh, table = save_abaqus(tmp_path, *heart, numbers)
    change(pd.read_csv(table)).to_csv(table, index=False)
    with pytest.raises(InputError) as error:
        import_mesh(mesh, table)
    assert str(table) in str(error.value)
    assert message in str(error.value)


def test_other_cells_and_other_files(tmp_path):
    meshio.Mesh(np.eye(4, 3), [("tetra", [[0, 1, 2, 3]])]).write(tmp_path / "tetra.vtu")
    with pytest.raises(InputError, match="holds tetra; a mesh of eight-node hexahedra"):
        import_mesh(tmp_path / "tetra.vtu")
    with pytest.raises(InputError, match="no such file"):
        import_mesh(tmp_path / "none.vtu")
    (tmp_path / "text.vtu").write_text("not a mesh")
    with pytest.raises(InputError, match=r"cannot be read \(it is damaged, or not of the kind"):
        import_mesh(tmp_path / "text.vtu")


# --- meshed anew -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fine(tmp_path_factory, smoke_config):
    return make(tmp_path_factory.mktemp("fine"), smoke_config, FINE)


@pytest.fixture(scope="module")
def remeshed(tmp_path_factory, fine, smoke_config):
    folder = tmp_path_factory.mktemp("remeshed")
    fibres = smoke_config["fibres"]
    source = save(folder / "heart.vtu", *corners_of(fine))
    write_imported(source, "mm", fibres, folder / "imported.vtu")
    names = ("mesh.msh", "mesh.vtu", "segments.csv", "summary.json", "fit.csv")
    remesh(folder / "imported.vtu", ANEW, fibres, *(folder / name for name in names))
    return read_mesh(folder / "mesh.vtu"), folder


def test_surfaces_fit(remeshed, fine):
    mesh, folder = remeshed
    assert mesh.cells.shape[1] == 27
    # The corners lie on the smooth heart that the linear mesh was cut from; its facets do not. The
    # apex of this heart is sharp, and few nodes tell its shape.
    for surface in (ENDOCARDIUM, EPICARDIUM):
        distance = surface_distances(fine, mesh, surface)
        assert np.sqrt((distance**2).mean()) < 0.35
        assert distance.max() < 1.5
    assert cavity_volume(mesh) == pytest.approx(cavity_volume(fine), rel=0.01)
    fit = pd.read_csv(folder / "fit.csv").set_index(["quantity", "part"])
    cavity = cavity_volume(read_mesh(folder / "imported.vtu"))
    assert fit.loc[("volume", "cavity"), "imported"] == pytest.approx(cavity, rel=1e-5)
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["fit_mm"]["endocardium_max"] == pytest.approx(
        fit.loc[("distance_max", "endocardium"), "difference"], rel=1e-4
    )


def test_an_oblique_base_is_refused(tmp_path, fine, smoke_config):
    """The base stays in its plane; the apex moves 15 degrees aside."""
    points, cells, segment = corners_of(fine)
    sheared = points + 0.27 * points[:, 2:] * [1, 0, 0]
    source = save(tmp_path / "heart.vtu", sheared, cells, segment)
    write_imported(source, "mm", smoke_config["fibres"], tmp_path / "imported.vtu")
    names = ("mesh.msh", "mesh.vtu", "segments.csv", "summary.json", "fit.csv")
    with pytest.raises(InputError, match=r"its apex lies 15 degrees off the z axis.*remesh: false"):
        remesh(
            tmp_path / "imported.vtu",
            ANEW,
            smoke_config["fibres"],
            *(tmp_path / name for name in names),
        )


def test_segments_stay(remeshed, fine):
    mesh, folder = remeshed
    np.testing.assert_allclose(segment_volumes(mesh), segment_volumes(fine), rtol=0.05)
    table = pd.read_csv(folder / "segments.csv")
    percent = 100 * (segment_volumes(mesh) / table["volume_imported_ml"] - 1)
    np.testing.assert_allclose(table["volume_deviation_percent"], percent, atol=1e-3)


def test_sector_borders_are_those_of_the_tags(remeshed, smoke_config):
    table = pd.read_csv(remeshed[1] / "segments.csv")
    given = read_segments(smoke_config["geometry"]["segments"])
    for side in ("angle_from_deg", "angle_to_deg"):
        off = (table[side] - given[side] + 180) % 360 - 180
        assert off[:16].abs().max() < 0.1


# --- the simulator on linear hexahedra -------------------------------------------------------


def test_linear_hexahedra_inflate_like_quadratic_ones(imported, quadratic, smoke_config):
    growth, dilations = [], []
    for mesh in (quadratic, imported):
        simulator = Simulator(mesh, physics_of(smoke_config))
        state = Solver(simulator, smoke_config["solver"]).inflate(np.ones(10), 8.0, Effort())
        # Relative to the cavity at zero pressure, of which flat facets cut a part off.
        growth.append(simulator.observables(state.w)[0][0] / cavity_volume(mesh))
        dilations.append(simulator.dilation(state.w))
    assert growth[1] > 1.4
    assert growth[1] == pytest.approx(growth[0], rel=0.04)
    assert max(dilations) < 0.06


# --- configuration ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("imported_cfg", "message"),
    [
        ({}, "geometry.imported.file: missing"),
        ({"file": "none.vtu"}, "geometry.imported.file: there is no file none.vtu"),
        ({"file": "published_heart", "segments": "x.csv"}, "comes with its segments; remove it"),
        ({"file": "published_heart", "unit": "inch"}, "choose one of mm, cm, m"),
    ],
)
def test_bad_config(imported_cfg, message):
    config = {"study": "mine", "geometry": {"source": "mesh", "imported": imported_cfg}}
    with pytest.raises(InputError) as error:
        study_config.load(config)
    assert message in str(error.value)


def test_published_heart_is_fetched_once(tmp_path, heart, smoke_config, monkeypatch):
    """By whatever needs it first; where a study is planned, nothing may be fetched."""
    fetched = []

    def fetch(name, mirror, download, destination):
        fetched.append(name)
        Path(destination).parent.mkdir(parents=True, exist_ok=True)
        inp, table = save_abaqus(tmp_path, *heart, np.arange(1, len(heart[1]) + 1))
        Path(destination).write_bytes((inp if name.endswith("inp") else table).read_bytes())

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(published, "fetch_published", fetch)
    monkeypatch.setattr(published, "HEART_SEGMENTS", "mesh/segments.csv")
    geometry = smoke_config["geometry"] | {
        "source": "mesh",
        "imported": {"file": "published_heart", "segments": None, "unit": "mm", "remesh": False},
    }
    config = smoke_config | {"geometry": geometry}
    make_heart(config, HeartFiles(f"{tmp_path}/"))
    by_own_table = by_table(config, tmp_path / "described.csv")["geometry"]
    assert fetched == [published.HEART_MESH, "mesh/segments.csv"]
    assert len(read_segments(by_own_table["segments"])) == 17
    study = {
        "study": "mine",
        "geometry": {"source": "mesh", "imported": {"file": "published_heart"}},
    }
    study_config.load(study)
    measured = {"inputs": {"segment_thickness": {"role": "measured", "sd_mm": 1.0}}}
    with pytest.raises(InputError, match="give the paths of its two files"):
        study_config.load(study | measured)
    assert len(fetched) == 2
