"""What every room shares: errors, the Earth, angles, a recorded run, progress.

In: nothing of graphnav. Out: dataclasses and helpers.
Not here: anything that knows a sensor's mathematics or reads a file.
"""
