"""The command: options in, one line out when something is wrong.

In: words of a shell. Out: calls of `pipeline`.
Not here: decisions; what the library cannot do the command cannot.
"""
