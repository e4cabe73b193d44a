"""Where calls go: the built-in interpreter (sim.py) or a controller (gts/).

place.py, rest.py: where on the path a run is, and what is left of it from there; dry.py: the same motion without light;
journal.py: what was really sent.
"""
