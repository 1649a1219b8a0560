"""The factor graph: nodes, unknowns, factors, elimination, noise found in residuals.

In: a prepared run and a timeline. Out: a problem, its solution and covariances.
Not here: the order of rounds (batch) or of nodes (stream).
"""
