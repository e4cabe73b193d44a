"""Where calls go: the vendor's library (gts/); the built-in interpreter is a room of its own.

place.py, rest.py: where on the path a run is, and what is left of it from there; dry.py: the same motion without light;
forecast.py: what a run is going to do; journal.py, sent.py: what was really sent; devices.py: what could be run on.
"""
