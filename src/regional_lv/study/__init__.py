"""A study as a whole: jobs and what they depend on, progress, faults, the record of its files."""
