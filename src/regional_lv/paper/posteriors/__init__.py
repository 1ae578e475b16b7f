"""Posteriors of test cases and scenarios: recovery, calibration, classification, trust."""
