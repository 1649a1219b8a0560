"""Pictures of a result: the recording for rerun, the report, the viewer.

In: a result directory. Out: run.rrd, report.html.
Not here: numbers of their own; a view shows what the result holds.
"""
