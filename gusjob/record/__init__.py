"""Run a user's program with a stand-in for the vendor's library, and record the calls that it makes as a listing.

stand_in/ is the C source of the stand-in: a virtual controller that also serves the tests. stand_in_source.py adds the
functions without a model, build.py builds it, recording.py runs the program.
"""
