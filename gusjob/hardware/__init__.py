"""A run on hardware, without a terminal: what commands and programs share.

run.py runs a compiled job: request.py defines what it takes, outcome.py what it returns. prepare.py makes the calls and
loads the library, forecast.py computes what will happen, locks.py prevents a second run, begin.py finds where to begin,
supervisor.py runs the driver's session in a thread and watches it, signals.py turns signals into requests to stop or
pause, progress.py computes the figures of a run, guard/ reports a run whose process ended without a shutdown.
journal_stream.py reads a journal as a stream of calls, devices/ finds libraries and controllers on this computer.
"""
