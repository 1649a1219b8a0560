"""The whole run at once: first path, rounds of states and graph, what was learnt.

In: a prepared run. Out: a `Solved`.
Not here: anything that a stream could use; that belongs to graph.
"""
