"""Conversions between units."""

KPA_PER_MMHG = 0.133322387415
