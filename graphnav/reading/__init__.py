"""What was recorded, and on what: the run file and the vehicle file.

In: paths. Out: a `Run` in SI and right-forward-up axes, a `Vehicle`, findings in words.
Not here: estimates; what a reader doubts is a finding, what a solver doubts is not.
"""
