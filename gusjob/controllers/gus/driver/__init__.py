"""The vendor's library as a backend: the only room that knows its ABI.

abi.py describes the libraries, library.py loads one, link.py makes calls, fifo.py keeps the FIFO full, session.py runs
a job from open to close, way_out.py turns light and motion off, runner.py watches over all of it.
"""
