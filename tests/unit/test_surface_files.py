"""Files of surfaces in every variant of their formats, written here byte by byte: the corners that
are read are those that were written."""

import struct

import meshio
import numpy as np
import pytest
import pyvista

from regional_lv.errors import InputError
from regional_lv.geometry.surface_files import read_surface
from regional_lv.geometry.vtk_triangles import triangles_of

POINTS = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0], [5, 5, 8.25]])
ROOF = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    **{"char": "b", "uint8": "B", "uchar": "B", "short": "h", "ushort": "H", "uint16": "H"},
    **{"int": "i", "int32": "i", "uint": "I", "float": "f", "float64": "d", "double": "d"},
}


@pytest.fixture
def in_process(monkeypatch):
    """What is valid needs no process of its own, which takes half a second."""
    monkeypatch.setattr("regional_lv.geometry.surface_files.read_triangles", triangles_of)


def corners(path):
    points, triangles = read_surface(path)
    return points[triangles]


# --- PLY -------------------------------------------------------------------------------------

XYZ = ("float x", "float y", "float z")
EDGE = ("edge", ("int vertex1", "int vertex2"), [{"vertex1": 0, "vertex2": 1}])
MATERIAL = ("material", ("list uchar float shades", "int kind"), [{}, {}])


def ply(form, *elements, comments=(), line="\n"):
    """Bytes of a PLY file; elements: name, properties, and rows by the properties' names."""
    order, text = ORDERS[form], [form]
    header, body = ["ply", f"format {form} 1.0", *comments], b""

    def put(kind, value):
        value = value if TYPES[kind] in "fd" else int(value)
        return struct.pack(order + TYPES[kind], value) if order else f"{value} ".encode()

    for name, properties, rows in elements:
        header.append(f"element {name} {len(rows)}")
        header += [f"property {words}" for words in properties]
        for row in rows:
            for *kinds, key in map(str.split, properties):
                if kinds[0] == "list":
                    values = row.get(key, [1, 2.5])
                    body += put(kinds[1], len(values))
                    body += b"".join(put(kinds[2], value) for value in values)
                else:
                    body += put(kinds[0], row.get(key, 7))
            body += b"" if order else line.encode()
    text = line.join([*header, "end_header", ""])
    return text.encode("latin-1") + body


def vertices(*properties):
    rows = [dict(zip("xyz", point, strict=True)) for point in POINTS]
    return ("vertex", properties or XYZ, rows)


def faces(*properties, of=ROOF):
    properties = properties or ("list uchar int vertex_indices",)
    keys = [words.split()[-1] for words in properties if "vertex_ind" in words]
    return ("face", properties, [dict.fromkeys(keys, face) for face in of])


INDICES = "list uchar int vertex_indices"
PLY = {
    "vertex_index": (vertices(), faces("list uchar int vertex_index")),
    "unsigned_indices": (vertices(), faces("list uchar uint vertex_indices")),
    "short_lists": (vertices(), faces("list ushort short vertex_indices")),
    "long_lists": (vertices(), faces("list int32 uint8 vertex_indices")),
    "doubles_in_any_order": (vertices("double z", "uchar red", "float64 x", "double y"), faces()),
    "list_of_a_vertex": (vertices("float x", "list uchar int near", "float y", "float z"), faces()),
    "texture": (vertices(), faces(INDICES, "list uchar float texcoord", "int texnumber")),
    "texture_first": (vertices(), faces("list uchar float texcoord", INDICES)),
    "colours": (vertices(*XYZ, "uchar red", "uchar alpha"), faces(INDICES, "uchar red")),
    "flags_first": (vertices(), faces("uchar flags", "float quality", INDICES)),
    "edges": (vertices(), faces(), EDGE),
    "others_first": (MATERIAL, EDGE, vertices(), faces()),
    "others_between": (vertices(), MATERIAL, faces()),
    "faces_first": (faces(), vertices()),
    "quadrilaterals": (vertices(), faces(of=[*ROOF, [0, 3, 2, 1]])),
}


@pytest.mark.parametrize("form", ORDERS)
@pytest.mark.parametrize("variant", PLY)
@pytest.mark.usefixtures("in_process")
def test_ply(variant, form, tmp_path):
    path = tmp_path / "heart.PLY"
    path.write_bytes(ply(form, *PLY[variant]))
    np.testing.assert_allclose(corners(path)[:4], POINTS[ROOF])


LONG = ("comment " + "x" * 5000, "comment M\xfcller \x85 element vertex 9", "obj_info of a test")
PLAIN = (vertices(), faces())
BYTES = {
    "comments.ply": ply("binary_little_endian", *PLAIN, comments=LONG),
    "windows.ply": ply("binary_big_endian", *PLAIN, line="\r\n"),
    "old_mac.ply": ply("binary_little_endian", *PLAIN, line="\r"),
    "mark.ply": b"\xef\xbb\xbf" + ply("ascii", *PLAIN),
    "integers.ply": ply("ascii", vertices("double x", "int y", "double z"), faces()),
    "one_line.ply": ply("ascii", *PLAIN).replace(b" \n", b" "),
}


# --- STL, OBJ, legacy VTK ----------------------------------------------------------------------


def stl(line="\n", name="heart", solids=1):
    text = []
    for part in np.array_split(ROOF, solids):
        text.append(f"solid {name}")
        for face in part:
            text += ["facet normal 0 0 0", " outer loop"]
            text += ["  vertex {:.6E} {:.6E} {:.6E}".format(*POINTS[i]) for i in face]
            text += [" endloop", "endfacet"]
        text.append(f"endsolid {name}")
    return line.join([*text, ""])


def binary_stl(head=b"", after=b"", attribute=0):
    triangles = [struct.pack("<12fH", 0, 0, 0, *POINTS[f].ravel(), attribute) for f in ROOF]
    return head.ljust(80, b"\0") + struct.pack("<I", 4) + b"".join(triangles) + after


def obj(face="{}", shift=1, points=POINTS):
    lines = ["v {} {} {}".format(*point) for point in points]
    lines += ["f " + " ".join(face.format(i + shift) for i in roof) for roof in ROOF]
    return "\n".join([*lines, ""])


def legacy(cells="POLYGONS 4 16\n{}", title="heart", data="POLYDATA"):
    rows = "\n".join(" ".join(map(str, [3, *face])) for face in ROOF)
    return (
        f"# vtk DataFile Version 3.0\n{title}\nASCII\nDATASET {data}\nPOINTS 5 float\n"
        + "\n".join(" ".join(map(str, point)) for point in POINTS)
        + f"\n{cells.format(rows)}\n"
    )


GRID = legacy("CELLS 4 16\n{}\nCELL_TYPES 4\n5 5 5 5", data="UNSTRUCTURED_GRID")
BYTES |= {
    "capitals.stl": stl().upper(),
    "title_case.stl": stl().title(),
    "mark.stl": "\ufeff" + stl(),
    "utf_16.stl": stl().encode("utf-16"),
    "latin_1.stl": stl(name="M\xfcller").encode("latin-1"),
    "old_mac.stl": stl(line="\r"),
    "solids.stl": stl(solids=2),
    "words_in_its_name.stl": stl(name="facet vertex 1 2 3"),
    "binary.stl": binary_stl(),
    "binary_solid.stl": binary_stl(head=b"solid heart\nfacet normal", attribute=0x7FFF),
    "binary_and_more.stl": binary_stl(after=b"xyz"),
    "mark.obj": "\ufeff" + obj(),
    "capitals.obj": obj().upper(),
    "negative.obj": obj(shift=-5),
    "texture.obj": "mtllib none.mtl\nvt 0 0\nvt 1 1\nvn 0 0 1\n" + obj("{}/2/1"),
    "colours.obj": obj(points=[f"{x} {y} {z} .5 .5 .5".split() for x, y, z in POINTS]),
    "groups.obj": "o heart\n" + obj().replace("f 1", "usemtl red\ns 1\ng wall\nl 1 2\nf 1", 1),
    "comments.obj": ("# M\xfcller" + "x" * 9000 + "\n" + obj()).encode("latin-1"),
    "windows.vtk": legacy().replace("\n", "\r\n"),
    "capitals.vtk": legacy().upper(),
    "mark.vtk": "\ufeff" + legacy(title="M\xfcller"),
    "grid.vtk": GRID,
    "strips.vtk": legacy("TRIANGLE_STRIPS 4 16\n{}"),
}


@pytest.mark.parametrize("name", BYTES)
@pytest.mark.usefixtures("in_process")
def test_bytes(name, tmp_path):
    path, content = tmp_path / name, BYTES[name]
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    np.testing.assert_allclose(corners(path)[:4], POINTS[ROOF].astype("float32"))


# --- what VTK and meshio write -------------------------------------------------------------------


def surface():
    return pyvista.PolyData.from_regular_faces(POINTS, ROOF)


@pytest.mark.parametrize("mode", ["ascii", "binary", "appended", "big_endian"])
@pytest.mark.usefixtures("in_process")
def test_vtp(mode, tmp_path):
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(tmp_path / "heart.vtp"))
    writer.SetInputData(surface())
    writer.SetDataMode({"ascii": 0, "binary": 1}.get(mode, 2))
    writer.SetByteOrder(0 if mode == "big_endian" else 1)
    writer.SetHeaderTypeToUInt64()
    writer.SetCompressorType({"binary": 3, "appended": 1}.get(mode, 0))
    writer.Write()
    np.testing.assert_allclose(corners(tmp_path / "heart.vtp"), POINTS[ROOF])
    content = (tmp_path / "heart.vtp").read_bytes()
    (tmp_path / "heart.vtp").write_bytes(b"\xef\xbb\xbf" + content)
    np.testing.assert_allclose(corners(tmp_path / "heart.vtp"), POINTS[ROOF])


@pytest.mark.parametrize("name", ["heart.vtk", "binary.vtk", "heart.obj"])
@pytest.mark.usefixtures("in_process")
def test_what_others_write(name, tmp_path):
    if name == "heart.vtk":
        surface().save(tmp_path / name, binary=True)
    else:
        meshio.Mesh(POINTS, [("triangle", np.array(ROOF))]).write(tmp_path / name)
    np.testing.assert_allclose(corners(tmp_path / name), POINTS[ROOF])


# --- faces of more points ------------------------------------------------------------------------


def with_middles(corners, bulge):
    """Points and faces of more points: after the corners, those in the middle of the edges."""
    points, found = list(POINTS), []
    for face in corners:
        ends = POINTS[[face, np.roll(face, -1)]]
        found.append([*face, *range(len(points), len(points) + len(face))])
        points += list(ends.mean(axis=0) + np.array([0, 0, bulge]))
    return np.array(points), found


@pytest.mark.parametrize("bulge", [0.0, 0.8])
@pytest.mark.parametrize("suffix", ["vtp", "vtk", "ply", "grid"])
@pytest.mark.usefixtures("in_process")
def test_six_node_faces_become_triangles(suffix, bulge, tmp_path):
    """Through all of their points; the area of flat ones stays what it is."""
    points, six = with_middles(ROOF, bulge)
    path = tmp_path / f"heart.{suffix.replace('grid', 'vtk')}"
    if suffix == "ply":
        rows = [dict(zip("xyz", point, strict=True)) for point in points]
        path.write_bytes(ply("binary_little_endian", ("vertex", XYZ, rows), faces(of=six)))
    elif suffix == "grid":
        kind = pyvista.CellType.QUADRATIC_TRIANGLE
        pyvista.UnstructuredGrid({kind: np.array(six)}, points).save(path)
    else:
        cells = np.concatenate([[6, *face] for face in six])
        pyvista.PolyData(points, faces=cells).save(path)
    found, triangles = read_surface(path)
    assert triangles.shape == (16, 3)
    used = [set(map(tuple, places.round(4))) for places in (found[triangles.ravel()], points)]
    assert used[0] == used[1]
    sides = found[triangles] - found[triangles][:, :1]
    area = np.linalg.norm(np.cross(sides[:, 1], sides[:, 2]), axis=1).sum() / 2
    flat = 4 * 0.5 * 10 * np.hypot(5, 8.25)
    assert area == pytest.approx(flat) if bulge == 0 else area > flat


@pytest.mark.parametrize("centre", [False, True])
@pytest.mark.usefixtures("in_process")
def test_eight_and_nine_node_faces(centre, tmp_path):
    points, eight = with_middles([[0, 1, 2, 3]], 0.0)
    face = [*eight[0], len(points)] if centre else eight[0]
    points = [*points, [5, 5, 0]]
    pyvista.PolyData(points, faces=[len(face), *face]).save(tmp_path / "heart.vtp")
    sides = np.diff(corners(tmp_path / "heart.vtp"), axis=1)
    assert np.cross(sides[:, 0], sides[:, 1])[:, 2].sum() / 2 == pytest.approx(100)
    assert len(sides) == 6


@pytest.mark.usefixtures("in_process")
def test_hexagons_are_no_six_node_faces(tmp_path):
    angle = np.arange(6) * np.pi / 3
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    pyvista.PolyData(points, faces=[6, *range(6)]).save(tmp_path / "heart.vtp")
    sides = np.diff(corners(tmp_path / "heart.vtp"), axis=1)
    assert len(sides) == 4
    assert np.cross(sides[:, 0], sides[:, 1])[:, 2].sum() / 2 == pytest.approx(1.5 * np.sqrt(3))


# --- what is refused -----------------------------------------------------------------------------

CUT = "cut off or damaged: export it again"


@pytest.mark.parametrize(
    "name, content, says",
    [
        *((f"heart.{s}", b"not a surface", "export") for s in ("stl", "ply", "obj", "vtp", "vtk")),
        *((f"heart.{s}", b"", "export") for s in ("stl", "ply", "obj", "vtp", "vtk")),
        ("heart.off", b"OFF", "the format .off is not read; save it as .stl, .ply, .obj, .vtp or"),
        ("heart", b"OFF", "the format without a suffix is not read"),
        ("cut.ply", ply("ascii", *PLAIN)[:-5], f"element `face` do; it is {CUT}"),
        ("cut.ply", ply("binary_big_endian", *PLAIN)[:-60], f"element `vertex` do; it is {CUT}"),
        ("points.ply", ply("ascii", vertices()), "has no element `face`; export the surface as"),
        ("middle.ply", ply("ascii", *PLAIN).replace(b"ascii", b"middle"), "its format `middle` is"),
        ("far.ply", ply("ascii", vertices(), faces(of=[[0, 1, 77]])), "export"),
        ("cut.stl", binary_stl()[:-1], "announces 4 triangles and holds 3; it is cut off"),
        ("cut.stl", stl()[:-40], "export the surface again"),
        ("far.obj", obj(shift=9), "export"),
        ("cut.vtk", legacy()[:-9], "holds no triangles, or is no VTK file; export the surface"),
        (
            "solid.vtk",
            GRID.replace("5 5 5 5", "10 5 5 5").replace("3 0 1 4", "4 0 1 2 4"),
            "no tri",
        ),
        ("far.vtk", legacy().replace("3 1 2 4", "3 1 2 77"), "export"),
    ],
)
def test_refused(name, content, says, tmp_path, capfd):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as refused:
        read_surface(path)
    assert str(refused.value).startswith(f"{path}: ") and says in str(refused.value)
    assert capfd.readouterr() == ("", "")


def test_faces_that_vtk_leaves_out_are_noticed(tmp_path):
    """Middles in an order that no format has."""
    points, six = with_middles(ROOF, 0.8)
    cells = np.concatenate([[6, *np.array(face)[[0, 1, 2, 4, 5, 3]]] for face in six])
    pyvista.PolyData(points, faces=cells).save(tmp_path / "heart.vtp")
    with pytest.raises(InputError, match="75 % of its faces cannot be divided into triangles"):
        read_surface(tmp_path / "heart.vtp")
