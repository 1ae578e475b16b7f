"""The polynomial through given places, for floats and for tensors."""


def lagrange(nodes, z) -> list:
    """Weight at `z` of the value at each of the `nodes`: 1 at its own place, 0 at the others."""
    weights = []
    for j, own in enumerate(nodes):
        weight = z * 0 + 1.0
        for k, other in enumerate(nodes):
            if k != j:
                weight = weight * (z - other) / (own - other)
        weights.append(weight)
    return weights
