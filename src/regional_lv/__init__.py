"""Regional stiffness of the left ventricle from segmental strains, with calibrated uncertainty."""

from regional_lv.study.surroundings import adapt

adapt()
