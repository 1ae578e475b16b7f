"""Constants of the normal distribution."""

import math
from statistics import NormalDist

LOG_2PI = math.log(2 * math.pi)

Z95 = NormalDist().inv_cdf(0.975)
"""Half the width of a central 95 % interval, in standard deviations."""
