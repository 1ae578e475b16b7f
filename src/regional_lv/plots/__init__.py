"""Figures: one module per family, each with `draw(inputs..., png, csv)`."""
