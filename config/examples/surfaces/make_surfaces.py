"""Two surfaces of a left ventricle, made with gmsh: endocardium.stl and epicardium.stl (synthetic).

    python config/examples/surfaces/make_surfaces.py

Both are half ellipsoids that are open at the base. The epicardium's middle lies towards the lateral
wall, so that the septum is the thinner one, and the whole is turned out of the axes and shifted, as
a scanner's frame would have it. The numbers that config.yaml needs are printed.
"""

from pathlib import Path

import gmsh
import numpy as np

FOLDER = Path(__file__).parent
# Half axes (mm): across from septum to lateral wall, across the other way, along.
ENDOCARDIUM, EPICARDIUM = (23.0, 25.0, 72.0), (33.0, 35.0, 81.0)
# The epicardium's middle, towards the lateral wall (mm).
LATERAL = 2.0
# Turns (rad) about x, y and z through the origin, in this order, and the shift (mm) after them.
TURNS = [((1, 0, 0), -0.6), ((0, 1, 0), 0.9), ((0, 0, 1), 0.4)]
SHIFT = (-30.0, 55.0, 120.0)
# Length (mm) of the triangles' edges.
EDGE = 2.5


def half_ellipsoid(axes, x, path):
    """Write the half below the plane through its middle, without that plane, as STL."""
    gmsh.model.add(path.stem)
    occ = gmsh.model.occ
    ball = occ.addSphere(0, 0, 0, 1, angle1=-np.pi / 2, angle2=0)
    occ.dilate([(3, ball)], 0, 0, 0, *axes)
    occ.translate([(3, ball)], x, 0, 0)
    for axis, angle in TURNS:
        occ.rotate([(3, ball)], 0, 0, 0, *axis, angle)
    occ.translate([(3, ball)], *SHIFT)
    occ.synchronize()
    # Only physical groups are written; the flat face is the base, which stays open.
    faces = [tag for _, tag in gmsh.model.getEntities(2)]
    curved = max(faces, key=lambda tag: occ.getMass(2, tag))
    gmsh.model.addPhysicalGroup(2, [curved])
    gmsh.option.setNumber("Mesh.MeshSizeMin", EDGE)
    gmsh.option.setNumber("Mesh.MeshSizeMax", EDGE)
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.model.mesh.generate(2)
    gmsh.write(str(path))


def turned(vector):
    """The vector (3,) after the turns."""
    for axis, angle in TURNS:
        axis, vector = np.array(axis, dtype=float), np.array(vector, dtype=float)
        # Rodrigues' formula.
        vector = (
            vector * np.cos(angle)
            + np.cross(axis, vector) * np.sin(angle)
            + axis * (axis @ vector) * (1 - np.cos(angle))
        )
    return vector


def main():
    gmsh.initialize(readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)
    half_ellipsoid(ENDOCARDIUM, 0.0, FOLDER / "endocardium.stl")
    half_ellipsoid(EPICARDIUM, LATERAL, FOLDER / "epicardium.stl")
    gmsh.finalize()
    print("septum:", turned([-1, 0, 0]).round(3).tolist())
    print("base: point", list(SHIFT), "normal", turned([0, 0, 1]).round(3).tolist())


if __name__ == "__main__":
    main()
