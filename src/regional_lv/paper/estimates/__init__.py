"""Point estimates of the test set by every emulator, and what they say of the emulators."""

ESTIMATORS = ("least_squares", "weighted")
