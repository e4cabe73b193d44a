"""A run on hardware, without a terminal: what commands and programs share.

run.py runs a compiled job: request.py is what it takes, locks.py keeps two runs apart, begin.py finds where to begin,
forecast.py computes what will happen, supervisor.py runs the driver's session in a thread and watches it, signals.py
turns signals into stop requests, progress.py makes figures of the state of a run, guard/ reports a run that is gone.
journal_stream.py reads a journal as a stream of calls, devices/ finds libraries and controllers on this computer.
"""
