"""What was found, as a user reads it: trajectory, tables, comparison, result directory.

In: a `Solved`. Out: files, whole or not at all, and their reading back.
Not here: estimation; a number that needs the solver is computed before.
"""
