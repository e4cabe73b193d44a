"""The driver: calls to the controller through the vendor's library.

abi.py describes the libraries and library.py loads one (elf.py guards against a truncated file, headers.py recognizes
one for another system or processor, inspection.py finds out which ABI a library fits, loaded_file.py finds the file
that the system loaded). link.py makes calls, prepared.py turns rows of a stream into calls, fifo.py keeps the FIFO
full, session.py runs a job from open to close (requirements.py: what it needs for that), shutdown.py turns laser and
motion off, resume.py finds where a recorded run was interrupted.
"""
