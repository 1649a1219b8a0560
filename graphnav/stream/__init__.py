"""The run as it comes: samples in, what the vehicle knew at every node out (iSAM2).

In: samples in order of time. Out: causal estimates.
Not here: the whole run; only `replay` knows the batch beside it.
"""
