"""Did the chains converge, and does the posterior find the truth?"""


def gate(chains, names, diverging, rhat_max, ess_min):
    return None, "passed"
