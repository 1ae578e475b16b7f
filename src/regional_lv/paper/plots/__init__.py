"""Figures of the comparison with the paper, one file each; every one writes its data as CSV too."""
