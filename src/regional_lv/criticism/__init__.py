"""What the simulation gets wrong, why, and what mending it gains."""
