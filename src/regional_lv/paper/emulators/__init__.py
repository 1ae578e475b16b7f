"""The eight emulators of the paper."""
