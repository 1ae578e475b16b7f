"""Regional stiffness of the left ventricle from segmental strains, with calibrated uncertainty."""

from regional_lv.surroundings import adapt

adapt()
