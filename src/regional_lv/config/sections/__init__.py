"""The sections of a configuration, a room or a stage per module."""
