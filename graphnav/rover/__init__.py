"""Rocker-bogie rovers: six wheels, linkage, the ground's profile (methods C).

In: a `Run` with a rover's running gear. Out: a `Solved`.
Not here: what other vehicles share; that belongs to graph.
"""
