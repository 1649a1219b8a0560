"""Motion states: which gear, which turn, and what the odometer means in each.

In: kinematics on a uniform grid. Out: a timeline of states and their corrections.
Not here: the graph that learns the corrections' constants.
"""
