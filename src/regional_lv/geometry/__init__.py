"""The left ventricle at zero pressure: segment table, surfaces, mesh, fibres, summary.

Coordinates are in mm. The z axis is the long axis, the base is the plane z = 0 and the apex points
to negative z; angles are counter-clockwise seen from the base, with 0 along +x.
"""
