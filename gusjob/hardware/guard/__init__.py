"""The guard: a small process that reports a run whose process ended without a shutdown, since it was killed or crashed.

start.py starts it and reports to it when the controller is open, process.py is the program of the process,
switch_off.py switches the controller off if the profile allows it. This module imports nothing, so that the process
starts fast.
"""
