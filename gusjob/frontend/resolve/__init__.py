"""Expanded statements to a Job: modal words become columns, positions absolute, numbers canonical.

Canonical units: pulse, ms, us, kHz, % or V.
"""
