"""Simulations: where, and what comes of them."""
