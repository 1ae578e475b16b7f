"""What the simulation gets wrong, why, and what fixing it gains."""
