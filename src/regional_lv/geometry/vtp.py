"""Triangles of a VTP file, read by VTK in a process of its own.

VTK's reader ends its process over a file whose header announces more bytes than there is memory.
Run as a script, this file reads one file and writes its arrays (NPZ) to the standard output.
"""

import io
import subprocess
import sys

import numpy as np


def read_vtp(path):
    """Points (n, 3) and triangles (m, 3) of a VTP file, as VTK makes of its polygons and strips.

    Raises ValueError if VTK ends the process over it.
    """
    # Without the script's folder, whose modules may have the names of others.
    done = subprocess.run([sys.executable, "-P", __file__, str(path)], capture_output=True)
    if done.returncode:
        raise ValueError("it announces more than it holds, or is damaged")
    arrays = np.load(io.BytesIO(done.stdout))
    return arrays["points"], arrays["triangles"]


def _print_triangles(path):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    reader, triangles = vtkXMLPolyDataReader(), vtkTriangleFilter()
    reader.SetFileName(path)
    triangles.SetInputConnection(reader.GetOutputPort())
    triangles.PassVertsOff()
    triangles.PassLinesOff()
    triangles.Update()
    found = triangles.GetOutput()
    arrays = {"points": np.zeros((0, 3)), "triangles": np.zeros((0, 3), dtype=int)}
    if found.GetNumberOfPolys():
        arrays["points"] = vtk_to_numpy(found.GetPoints().GetData())
        arrays["triangles"] = vtk_to_numpy(found.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    sys.stdout.buffer.write(stream.getvalue())


if __name__ == "__main__":
    _print_triangles(sys.argv[1])
