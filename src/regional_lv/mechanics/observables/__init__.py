"""What is observed of a solution: strain measure, layer, segments, and the channels' values."""
