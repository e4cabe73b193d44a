"""The guard: a small process that outlives a run which crashes or is killed, and reports that.

start.py starts it and tells it when the controller is open, process.py is the program of the process, switch_off.py
what it does beyond a message if the profile says so. This module imports nothing: the process imports it late.
"""
