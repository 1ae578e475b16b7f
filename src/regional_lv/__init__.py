"""Regional stiffness of the left ventricle from segmental strains, with calibrated uncertainty."""
