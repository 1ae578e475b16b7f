"""The left ventricle at zero pressure: segment table, surfaces, mesh, fibres, summary.

Coordinates are in mm. The z axis is the long axis, the base is the plane z = 0 (of a ventricle from
two surfaces a plane through the origin, which may be oblique) and the apex points to negative z;
angles are counter-clockwise seen from the base, with 0 along +x.
"""
