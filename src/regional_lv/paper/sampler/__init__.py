"""Posteriors of the stiffness alone, by any emulator, as the paper has them."""
