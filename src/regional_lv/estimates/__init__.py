"""Point estimates of the test set by every emulator, and what they say of the emulators."""
