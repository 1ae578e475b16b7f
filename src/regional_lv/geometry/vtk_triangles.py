"""Triangles of a surface's file, read by VTK in a process of its own.

VTK's readers end their process over some damaged files: a number of a node that is not there, a
header that announces more bytes than there is memory. Run as a script, this file reads one file
and writes its arrays (NPZ) to the standard output.
"""

import io
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

# Share of an edge's length within which a face's further point counts as in the edge's middle.
MIDDLE = 0.25


def read_triangles(path: str | Path) -> tuple[np.ndarray, np.ndarray, float]:
    """Points (n, 3), triangles (m, 3) of a file .stl, .ply, .obj, .vtp or .vtk, and how many of the
    triangles that its polygons should make these are (a share).

    Polygons and strips become triangles. So do faces of 6 to 9 points that lie at the corners of
    a triangle or a quadrilateral, then in the middles of its edges (then in its own): four of a
    triangle, six of a quadrilateral.

    Raises ValueError if VTK ends the process over it.
    """
    # Without the script's folder, whose modules may have the names of others.
    done = subprocess.run([sys.executable, "-P", __file__, str(path)], capture_output=True)
    if done.returncode:
        raise ValueError("it announces more than it holds, or is damaged")
    arrays = np.load(io.BytesIO(done.stdout))
    return arrays["points"], arrays["triangles"], float(arrays["share"])


def _read(path: str) -> Any:
    """The file's data set in VTK's types, one of surfaces; None if there is none in it."""
    from vtkmodules.vtkCommonDataModel import vtkPolyData, vtkUnstructuredGrid
    from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter
    from vtkmodules.vtkIOGeometry import vtkOBJReader, vtkSTLReader
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
    from vtkmodules.vtkIOPLY import vtkPLYReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    readers: dict[str, Any] = {
        ".obj": vtkOBJReader,
        ".ply": vtkPLYReader,
        ".stl": vtkSTLReader,
        ".vtk": vtkGenericDataObjectReader,
        ".vtp": vtkXMLPolyDataReader,
    }
    reader = readers[Path(path).suffix]()
    reader.SetFileName(path)
    reader.Update()
    data = reader.GetOutputDataObject(0)
    if isinstance(data, vtkUnstructuredGrid):
        # Of volumes it would take the outside.
        if data.GetNumberOfCells() == 0 or data.GetMaxSpatialDimension() > 2:
            return None
        surface = vtkDataSetSurfaceFilter()
        surface.SetInputData(data)
        surface.Update()
        return surface.GetOutput()
    return data if isinstance(data, vtkPolyData) and data.GetNumberOfPoints() else None


def _polygons(cells: Any) -> Iterator[np.ndarray]:
    """Point numbers (k, n) of the polygons that have n points, for every n."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    start, point = (
        vtk_to_numpy(array) for array in (cells.GetOffsetsArray(), cells.GetConnectivityArray())
    )
    size = np.diff(start)
    for n in np.unique(size[size > 2]):
        yield point[start[:-1][size == n][:, None] + np.arange(n)]


def _with_middles(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which of the faces (k, n) have a point in the middle of each edge after their corners."""
    corners = faces.shape[1] // 2
    if corners not in (3, 4):
        return np.zeros(len(faces), dtype=bool)
    ends, middles = points[faces[:, :corners]], points[faces[:, corners : 2 * corners]]
    following = np.roll(ends, -1, axis=1)
    off = np.linalg.norm(middles - (ends + following) / 2, axis=2)
    return (off <= MIDDLE * np.linalg.norm(following - ends, axis=2)).all(axis=1)


def _pieces(faces: np.ndarray) -> np.ndarray:
    """Triangles (m, 3) of such faces: one at each corner, and the rest between the middles."""
    corners = faces.shape[1] // 2
    edges = faces[:, corners : 2 * corners]
    around = np.roll(edges, 1, axis=1)
    found = [np.stack([faces[:, i], edges[:, i], around[:, i]], axis=1) for i in range(corners)]
    found += [edges[:, [0, i, i + 1]] for i in range(1, corners - 1)]
    return np.concatenate(found)


def _triangulated(points: np.ndarray, faces: Sequence[np.ndarray], strips: Any) -> np.ndarray:
    """Triangles (m, 3), by VTK, of faces (a list of (k, n)) and VTK's strips."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    size = np.concatenate([np.full(len(alike), alike.shape[1]) for alike in faces])
    start = np.concatenate([[0], np.cumsum(size)])
    point = np.concatenate([alike.ravel() for alike in faces]).astype(np.int64)
    places, cells, given = vtkPoints(), vtkCellArray(), vtkPolyData()
    places.SetData(numpy_to_vtk(np.ascontiguousarray(points)))
    cells.SetData(*(numpy_to_vtk(array, deep=True) for array in (start, point)))
    given.SetPoints(places)
    given.SetPolys(cells)
    given.SetStrips(strips)
    triangles = vtkTriangleFilter()
    triangles.SetInputData(given)
    triangles.Update()
    made = triangles.GetOutput().GetPolys().GetConnectivityArray()
    return vtk_to_numpy(made).reshape(-1, 3) if made.GetNumberOfValues() else _NONE


_NONE = np.zeros((0, 3), dtype=np.int64)


def _expected(points: np.ndarray, faces: np.ndarray) -> int:
    """How many triangles faces (k, n) make; points that coincide with the one before count once."""
    apart = (points[faces] != points[np.roll(faces, 1, axis=1)]).any(axis=2)
    return np.maximum(apart.sum(axis=1) - 2, 0).sum()


def triangles_of(path: str | Path) -> tuple[np.ndarray, np.ndarray, float]:
    """What `read_triangles` returns, in this process."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    data = _read(str(path))
    if data is None:
        return np.zeros((0, 3)), _NONE, 0.0
    points = vtk_to_numpy(data.GetPoints().GetData()).astype(float)
    faces = [_NONE]
    for alike in _polygons(data.GetPolys()):
        middles = _with_middles(points, alike)
        faces += [_pieces(alike[middles]), alike[~middles]] if middles.any() else [alike]
    triangles = _triangulated(points, faces, vtkCellArray())
    # VTK goes on without polygons that it cannot divide, such as those that cross themselves.
    expected = sum(_expected(points, alike) for alike in faces)
    share = len(triangles) / expected if expected else 1.0
    strips = _triangulated(points, [_NONE], data.GetStrips())
    return points, np.concatenate([triangles, strips]), share


if __name__ == "__main__":
    stream = io.BytesIO()
    points, triangles, share = triangles_of(sys.argv[1])
    np.savez(stream, points=points, triangles=triangles, share=share)
    sys.stdout.buffer.write(stream.getvalue())
