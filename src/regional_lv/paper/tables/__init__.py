"""Tables of the comparison with the paper."""
