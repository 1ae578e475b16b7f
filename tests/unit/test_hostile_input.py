"""Input that is damaged or hostile is used or refused with the file and the remedy, never else.

`FUZZ_EXAMPLES` says how many variants of each kind are tried (`make test-fuzz`: thousands).
"""

import ast
import base64
import copy
import os
import struct
import zlib

import meshio
import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

from regional_lv import config as study_config
from regional_lv.channels import Channels
from regional_lv.criticism.study import read_known_theta
from regional_lv.errors import InputError
from regional_lv.geometry.imported import import_mesh
from regional_lv.geometry.segment_tags import PUBLISHED_FIELD, read_segment_tags
from regional_lv.geometry.table import read_segments
from regional_lv.geometry.triangulated import read_ventricle
from regional_lv.hearts.listing import COLUMNS, list_hearts
from regional_lv.input_files import MOST_GB, reading
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured import read_measured
from regional_lv.measured.curves import read_curve_subject
from regional_lv.simulation.tables import read_tables
from tests.unit import hostile
from tests.unit.test_imported_mesh import ROWS, corners_of, make, save_abaqus
from tests.unit.test_surfaces import ENDO, EPI, ellipsoid, save

PARAMETERS, CHANNELS = StiffnessInputs(), Channels.of()
DIRECTIONS = {"circumferential": -0.18, "radial": 0.35, "longitudinal": -0.13}
STRAINS = [f"{name}_{segment:02d}" for name in DIRECTIONS for segment in range(1, 18)]


def try_all(strategy, path, read, share=1.0) -> None:
    """Write variants to `path` and `read` each; at least one of them has to be refused."""
    refused = []

    def attempt(content):
        if isinstance(content, str):
            content = content.encode("utf-8", "surrogatepass")
        path.write_bytes(content)
        if hostile.accepted_or_refused(path, read, path) is None:
            refused.append(len(content))

    hostile.profile(share)(given(strategy)(attempt))()
    assert refused


# ----------------------------------------------------------------------------------- tables


def segment_rows(root):
    text = (root / "src/regional_lv/data/volunteer_segments.csv").read_text()
    return [line.split(",") for line in text.splitlines() if not line.startswith("#")]


def measured_rows(root):
    table = pd.read_csv(root / "src/regional_lv/data/measured_template.csv", dtype=str).fillna("")
    sizes = {"volume": 170.0} | {name: 100 * size for name, size in DIRECTIONS.items()}
    table["value"] = [f"{sizes[name]:g}" for name in table["quantity"]]
    return [list(table.columns), *table.to_numpy().tolist()]


def curve_rows(_):
    """Synthetic curves of twelve frames."""
    shape = np.sin(np.pi * np.linspace(0, 1, 12)) ** 2
    sizes = [DIRECTIONS[name[:-3]] for name in STRAINS]
    rows = [[str(i), *(f"{s * v:.4f}" for s in sizes)] for i, v in enumerate(shape, 1)]
    return [["frame", *STRAINS], *rows]


def theta_rows(_):
    return [["subject", *PARAMETERS.names], *([f"s{i}", *["1.5"] * 10] for i in range(3))]


def tag_rows(_):
    return [["element", "aha_segment"], *([str(i), str(1 + i % 17)] for i in range(1, 60))]


def simulation_rows(_):
    values = np.random.default_rng(1).uniform(0.1, 5, (8, 62))
    return [[*PARAMETERS.names, *CHANNELS.names], *([f"{v:.4f}" for v in row] for row in values)]


def heart_rows(_):
    files = [["segments.csv", "-74.4", "-81.2", "8", f"{name}.csv"] for name in "abc"]
    return [["heart", *COLUMNS], *([f"heart{i}", *row] for i, row in enumerate(files))]


CURVE_SUBJECT = {
    **{"unit": "fraction", "reference": "end_diastole", "measure": "engineering"},
    **{"frame": "earliest_diastole", "end_diastole_frame": None},
    **{"volume_ml": 170.0, "sd": {"strain": 0.02, "volume": 2.0}},
}
TABLES = {
    "geometry": (segment_rows, read_segments),
    "measured": (measured_rows, lambda path: read_measured(path, CHANNELS, 8.0, 2.0)),
    "curves": (
        curve_rows,
        lambda path: read_curve_subject({**CURVE_SUBJECT, "curves": path}, CHANNELS, 2.0),
    ),
    "thetas": (theta_rows, lambda path: read_known_theta([path], ["s0", "s2"], PARAMETERS.names)),
    "tags": (tag_rows, lambda path: read_segment_tags(path, np.arange(1, 60))),
    "hearts": (heart_rows, lambda path: list_hearts(str(path))),
    "simulations": (simulation_rows, lambda path: read_tables(path, path, PARAMETERS, CHANNELS)),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", TABLES)
def test_tables(kind, tmp_path, root):
    rows, read = TABLES[kind]
    valid = rows(root)
    path, text = tmp_path / "hostile.csv", "\n".join(map(",".join, valid))
    path.write_text(text)
    assert len(read(path))
    try_all(hostile.broken_table(valid) | hostile.broken_bytes(text.encode()), path, read)


WRONG = (None, "x", np.nan, np.inf, [1.0], {"a": 1}, b"\xff", pd.Timestamp(0), [None])


def simulations() -> pd.DataFrame:
    rng = np.random.default_rng(1)
    names = [*PARAMETERS.names, *CHANNELS.names]
    table = pd.DataFrame(rng.uniform(0.1, 5, (8, 62)), columns=names)
    return table.assign(sensitivity=list(rng.normal(size=(8, 520))))


def test_parquet(tmp_path):
    path, valid = tmp_path / "hostile.parquet", simulations()
    valid.to_parquet(path)
    try_all(hostile.broken_bytes(path.read_bytes()), path, lambda p: TABLES["simulations"][1](p))
    for column in ("C_a_apical", "volume_ml", "sensitivity"):
        for wrong in WRONG:
            valid.assign(**{column: [wrong] * 8}).to_parquet(path)
            assert hostile.accepted_or_refused(path, TABLES["simulations"][1], path) is None
    # An index is no column, whatever its name.
    valid.set_index("volume_ml").to_parquet(path)
    assert len(TABLES["simulations"][1](path)) == 8


# ----------------------------------------------------------------------------------- shapes


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "vtp", "vtk"])
def test_surfaces(suffix, tmp_path):
    for name, shape in (("endo", ENDO), ("epi", EPI)):
        points, faces = ellipsoid(*shape, around=24, rows=16)
        save(tmp_path / f"{name}.{suffix}", points.astype("float32"), faces, np.eye(3))
    path, other = (tmp_path / f"{name}.{suffix}" for name in ("endo", "epi"))

    def read(path):
        try:
            return read_ventricle(path, other, septum=[1, 0, 0])
        except InputError as error:
            # Of the two, it may be the other one that does not fit.
            raise InputError(f"{path}: {error}") from None

    assert read(path).cavity_volume_ml == pytest.approx(83.3, abs=0.1)
    try_all(hostile.broken_bytes(path.read_bytes()), path, read)


@pytest.fixture(scope="module")
def heart(tmp_path_factory, smoke_config):
    return corners_of(make(tmp_path_factory.mktemp("heart"), smoke_config, ROWS))


@pytest.mark.parametrize("suffix", ["vtu", "ascii.vtu", "inp", "msh", "ascii.msh"])
def test_meshes(suffix, tmp_path, heart):
    points, cells, segment = heart
    path, tags = tmp_path / f"heart.{suffix}", None
    if suffix == "inp":
        path, tags = save_abaqus(tmp_path, points, cells, segment, np.arange(1, len(cells) + 1))
    else:
        mesh = meshio.Mesh(points, [("hexahedron", cells)], cell_data={"segment": [segment]})
        kind = meshio.vtu if suffix.endswith("vtu") else meshio.gmsh
        kind.write(path, mesh, binary=not suffix.startswith("ascii"))
    assert len(import_mesh(path, tags).cells) == len(cells)
    try_all(hostile.broken_bytes(path.read_bytes()), path, lambda p: import_mesh(p, tags), 0.5)


def test_matlab_tags(tmp_path):
    path, numbers = tmp_path / "hostile.mat", np.arange(1, 60)
    labels = (1 + numbers % 17).astype(np.uint8)
    for compressed in (False, True):
        savemat(path, {"division": {PUBLISHED_FIELD: labels}}, do_compression=compressed)
        assert sorted(set(read_segment_tags(path, numbers))) == list(range(1, 18))
        valid = path.read_bytes()
        try_all(hostile.broken_bytes(valid), path, lambda p: read_segment_tags(p, numbers), 0.5)


@pytest.mark.parametrize("announced", [10**7, 2**33, 2**62])
def test_a_compressed_array_may_announce_anything(tmp_path, announced):
    """A VTP of few points whose arrays announce many bytes, more than there is memory or not."""
    path, block = tmp_path / "bomb.vtp", zlib.compress(bytes(10**7))
    header = struct.pack("<4Q", 1, announced, 0, len(block))
    data = (base64.b64encode(header) + base64.b64encode(block)).decode()
    array = '<DataArray type="{}" Name="{}" NumberOfComponents="{}" format="binary">' + data
    points, ends, starts = (
        array.format(*kind) + "</DataArray>"
        for kind in (
            ("Float32", "Points", 3),
            ("Int64", "offsets", 1),
            ("Int64", "connectivity", 1),
        )
    )
    path.write_text(
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64" '
        'compressor="vtkZLibDataCompressor"><PolyData><Piece NumberOfPoints="500" '
        f'NumberOfPolys="500"><Points>{points}</Points><Polys>{starts}{ends}</Polys></Piece>'
        "</PolyData></VTKFile>"
    )
    with pytest.raises(InputError, match=r"bomb\.vtp: .*export the surface again"):
        read_ventricle(path, path, septum=[1, 0, 0])


@pytest.mark.parametrize(
    "name, content, says",
    [
        ("points.ply", b"ply\nformat ascii 1.0\nelement vertex 4000000000\nend_header\n", "announ"),
        ("points.vtp", b'<VTKFile><Piece NumberOfPoints="4000000000"/></VTKFile>', "announces"),
    ],
)
def test_announced_sizes_are_refused(tmp_path, name, content, says):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_ventricle(tmp_path / name, tmp_path / name, septum=[1, 0, 0])


def test_size_and_memory_are_bounded(tmp_path):
    huge, bomb = tmp_path / "huge.csv", tmp_path / "bomb"
    with huge.open("wb") as file:
        file.truncate(10**12)  # a sparse file
    with pytest.raises(InputError, match=r"huge\.csv: has 1000000 MB"):
        read_segments(huge)
    bomb.write_bytes(b"")
    with pytest.raises(InputError, match=f"takes more than {MOST_GB} GB"):
        with reading(bomb, "give a smaller one"):
            np.zeros((MOST_GB + 1) * 2**27)
    for path in ("/dev/zero", str(tmp_path), "a\x00b"):
        with pytest.raises(InputError, match=r"is no file|cannot be read"):
            read_segments(path)


# ----------------------------------------------------------------------------------- configurations


@st.composite
def configurations(draw, valid):
    config = copy.deepcopy(valid)
    for _ in range(draw(st.integers(1, 3))):
        *sections, key = draw(st.sampled_from(hostile.places(valid)))
        here = config
        for section in sections:
            here = here[section] if isinstance(here, dict) and section in here else {}
        if not isinstance(here, dict):
            continue
        what = draw(st.sampled_from(("set", "set", "lose", "add")))
        if what == "set":
            here[key] = draw(hostile.values())
        elif what == "lose":
            here.pop(key, None)
        else:
            here[draw(st.sampled_from(("x", "x\n", "../x", "", "a" * 300, "é")))] = here.get(key)
    return config


def test_configurations(smoke_config):
    def attempt(config):
        hostile.accepted_or_refused("a.yaml", study_config.load, config, "a.yaml")

    valid = yaml.safe_load(yaml.safe_dump(smoke_config))
    hostile.profile()(given(configurations(valid))(attempt))()


def test_text_of_configurations(tmp_path, root):
    files = [root / "config" / f"{name}.yaml" for name in ("smoke", "quick", "study")]
    texts = st.sampled_from([file.read_bytes() for file in files])
    try_all(texts.flatmap(hostile.broken_bytes), tmp_path / "hostile.yaml", study_config.load)


BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)


@pytest.mark.parametrize(
    "text, says",
    [
        ("study: !!python/object/apply:os.system ['touch executed']", "not valid YAML"),
        ("study: !!python/name:os.system", "not valid YAML"),
        (f"study: mine\n{BOMB}", "aliases"),
        ("study: mine\nmesh: &m {basal: *m}", "aliases"),
        ("study: mine\nmesh: " + "[" * 500, "nested too deeply"),
        ("study: mine\nseed: 1" + "0" * 400, "too large"),
        ("study: mine\nloading: {pressure_mmhg: .nan}", "finite"),
        ("study: mine\nseed: 2020-02-31", "is not a whole number"),
        ("study: mine\nseed: !!timestamp 2020-02-31", "cannot be read"),
        ("study: mine\nseed: !!binary YQ==", "neither"),
        ("study: " + "a" * 300, "shorten"),
    ],
)
def test_yaml_neither_executes_nor_exhausts(tmp_path, monkeypatch, text, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(InputError, match=says) as refused:
        study_config.load(tmp_path / "mine.yaml")
    assert len(str(refused.value)) < 5000 and not (tmp_path / "executed").exists()


@pytest.mark.parametrize(
    "name", ["", "..", "../x", "/x", "a/b", "a\\b", "x\n", "a b", "x\x00", "~"]
)
def test_no_name_leaves_the_folder_of_the_study(name):
    synthetic = {"theta": dict.fromkeys(PARAMETERS.names, 1.0)}
    for config in (
        {"study": name},
        {"subjects": {name: {"source": "synthetic"}}},
        {"synthetic_subjects": {name: synthetic}},
        {"scenarios": {"sets": {name: {"mu": 1.0}}}},
        {"criticism": {"joint": {name: {"subjects": ["synthetic_lateral"]}}}},
        {"parameters": {"zones": {name: list(range(1, 18))}}},
        {"simulations": {"source": "table", "tables": {name: {"inputs": "x", "outputs": "y"}}}},
        {"emulators": {"names": [name]}},
        {"emulators": {name: {}}},
        {"observables": {"quantities": [name]}},
    ):
        with pytest.raises(InputError):
            study_config.load({"study": "mine"} | config)


# ----------------------------------------------------------------------------------- code


def test_nothing_is_unpickled_nor_evaluated(root):
    """In the package's and the workflow's own code."""
    for path in [*(root / "src").rglob("*.py"), *(root / "workflow").rglob("*.py")]:
        tree, name = ast.parse(path.read_text()), str(path.relative_to(root))
        for node in ast.walk(tree):
            if isinstance(node, ast.Import | ast.ImportFrom):
                modules = {alias.name for alias in node.names} | {getattr(node, "module", "")}
                assert not modules & {"pickle", "joblib", "dill", "cloudpickle", "shelve"}, name
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func)
            options = {option.arg: ast.unparse(option.value) for option in node.keywords}
            assert called not in ("eval", "exec", "yaml.load", "pd.read_pickle"), name
            assert options.get("allow_pickle", "False") == "False", name
            if called == "torch.load":
                assert options.get("weights_only") == "True", name


def test_a_pickle_is_not_read_as_an_emulator(tmp_path):
    import torch

    from regional_lv.emulators import load

    class Hostile:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "executed"),)

    torch.save({"emulator": Hostile()}, tmp_path / "emulator.pt")
    with pytest.raises(Exception, match=r"weights_only|Weights only"):
        load(tmp_path / "emulator.pt")
    assert not (tmp_path / "executed").exists()
