"""From outputs to parameters: likelihood, point estimates, posteriors and their checks."""
