"""The inertial samples made ready: increments, standstill, alignment, dead reckoning.

In: a `Run` and its `Vehicle`. Out: increments, rests, an alignment, odometer sums.
Not here: unknowns of the graph; nothing in this room is iterated.
"""
