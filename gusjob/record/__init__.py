"""Run a user's program with a stand-in for the vendor's library, and record the calls that it makes as a listing.

    from pathlib import Path
    from gusjob.record import Recording, RecordOptions, record

    recording = record(RecordOptions(command=("./mark", "40"), output=Path("calls.gts")))
    if isinstance(recording, Recording):
        print(recording.calls, recording.exit_code)

stand_in/ is the C source of the stand-in: a virtual controller that also serves the tests. stand_in_source.py adds the
functions without a model, build.py builds it, recording.py runs the program, listings.py has the files that come out.
"""

from gusjob.record.build import BuildError, Target
from gusjob.record.recording import Fault, Recording, RecordOptions, parse_fault, record, write_library

__all__ = ["BuildError", "Fault", "RecordOptions", "Recording", "Target", "parse_fault", "record", "write_library"]
