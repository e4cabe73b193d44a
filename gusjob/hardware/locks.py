"""Locks of a run: a controller has one run at a time, and one run continues a journal.

The operating system holds a lock and releases it when its process ends, however that happens. It locks an empty file;
a second file beside it names the holder, since Windows does not let others read a locked one.
"""

from __future__ import annotations

import errno
import hashlib
import os
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import orjson
from msgspec import Struct
from msgspec.structs import replace

from gusjob.config.machine import ControllerSettings
from gusjob.controllers.gus.driver.library import Library
from gusjob.controllers.gus.driver.loaded_file import file_of
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic
from gusjob.hardware.request import Refusal, RunRequest, read_recorded_run
from gusjob.i18n.phrases import Phrase, printable, reason_of

_TRIES = 5
_SLEEP_S = 0.02
"""Interval between attempts: another run may be creating, removing or writing the file."""
_HOLDER_BYTES = 4096
"""Maximum size of a holder file."""


def _shared_folder() -> Path:
    """Return the folder of the locks: the same one for all users of the computer, in every shell."""
    # The temporary folder of tempfile depends on TMPDIR, and on macOS and Windows each user has another one. /tmp
    # itself is one folder that everybody can write to on Linux and macOS; on many systems /run/lock is not. On Windows
    # everybody can write to files in the public folder, but only their creator to those in ProgramData. All of these
    # are local, as a controller is: locks on network drives are not certain.
    if sys.platform == "win32":
        return Path(os.environ.get("PUBLIC", r"C:\Users\Public")) / "gusjob-locks"
    return Path("/tmp/gusjob-locks")


LOCK_FOLDER = _shared_folder()


class RunLock(Struct, frozen=True, kw_only=True):
    """A lock that a run takes. `name`: equal for all who need the same; `what`: a phrase for what it protects."""

    name: str
    what: str

    @property
    def path(self) -> Path:
        """The file that is locked."""
        return LOCK_FOLDER / f"{hashlib.sha256(self.name.encode('utf-8', 'surrogatepass')).hexdigest()[:32]}.lock"

    @property
    def holder_path(self) -> Path:
        """The file that names the holder."""
        return self.path.with_suffix(".holder")

    @property
    def last_path(self) -> Path:
        """The file that names the journal of the last run on the controller; it remains when the lock is free."""
        return self.path.with_suffix(".last")

    def last_run(self) -> tuple[str, str]:
        """Return start time and journal of the run that used the controller last, ('', '') if it is not known."""
        with suppress(OSError, ValueError, KeyError, TypeError):
            found = orjson.loads(_read_shared(self.last_path))
            return str(found["started"]), printable(str(found["journal"]))
        return "", ""

    def note_run(self, started: str, journal: Path) -> None:
        """Record the run that uses the controller now.

        Raises:
            OSError: it can't be written.
        """
        _write_shared(self.last_path, orjson.dumps({"started": started, "journal": printable(str(journal.resolve()))}))

    def acquire(self, job: str) -> HeldLock | None:
        """Take the lock, without waiting.

        Args:
            job: the job that is named to others.

        Returns:
            The lock; None if another run has it, in this process or in another one.

        Raises:
            OSError: the lock can't be taken, as in a folder where this user may not write.
        """
        from filelock import lock_descriptor

        _make_folder()
        for _ in range(_TRIES):
            descriptor = _open_shared(self.path)
            try:
                if not lock_descriptor(descriptor, blocking=False):
                    break
                if _is_at(descriptor, self.path):
                    held, descriptor = HeldLock(lock=self, descriptor=descriptor), -1
                    held.name_holder(job)
                    return held
            finally:
                if descriptor >= 0:
                    os.close(descriptor)
        return None

    def holder(self) -> str:
        """Return a phrase that names who has the lock."""
        for _ in range(_TRIES):
            with suppress(OSError, ValueError, KeyError, TypeError):
                text = _read_shared(self.holder_path)
                found = orjson.loads(text)
                pid, job = found["pid"], found["job"]
                if isinstance(pid, int) and isinstance(job, str):
                    return Phrase("process {pid}, which runs {job}", pid=pid, job=printable(job))
            time.sleep(_SLEEP_S)  # The holder may have taken the lock just now.
        return Phrase("another process")


class HeldLock(Struct, kw_only=True):
    """A lock that this process has."""

    lock: RunLock
    descriptor: int

    def name_holder(self, job: str) -> None:
        """Write who has the lock. Without that file others are refused all the same."""
        with suppress(OSError):
            text = orjson.dumps({"pid": os.getpid(), "job": printable(job)[: _HOLDER_BYTES // 8]})
            _write_shared(self.lock.holder_path, text)

    def release(self) -> None:
        """Release the lock and remove its files."""
        from filelock import unlock_descriptor

        # Removed while it is locked: a process that opened it before finds that it is not at its path any more. Windows
        # does not remove an open file, and the sticky bit keeps files of other users: they remain, which is harmless.
        for path in (self.lock.holder_path, self.lock.path):
            with suppress(OSError):
                path.unlink()
        with suppress(OSError):
            unlock_descriptor(self.descriptor)
        os.close(self.descriptor)


# The locks of a run.


@contextmanager
def run_locks(request: RunRequest, library: Library) -> Iterator[Diagnostic | Refusal | None]:
    """Hold the locks of a run while the context lasts.

    Yields:
        None if they are held, else why not: a diagnostic if another run has one, a refusal if locking failed.
    """
    locks = [controller_lock(library, request.machine.controller)]
    if request.options.resume is not None:
        locks.append(_journal_lock(request.options.resume.path))
    with ExitStack() as held:
        yield next((why for lock in locks if (why := _enter(lock, request.path, held)) is not None), None)


def controller_lock(library: Library, controller: ControllerSettings) -> RunLock:
    """Return the lock of a controller, as it is reached: library, card and channel of GT_Open.

    A library is its file: links to it are the same library. Only a library of several cards has a card.
    """
    leading = library.prototypes["GT_Open"].leading
    card, channel = (leading[0] if leading else 0), controller.open_channel
    what = Phrase(
        "the controller of {library} (card {card}, channel {channel})",
        library=printable(library.path),
        card=card,
        channel=channel,
    )
    return RunLock(name=f"controller\0{_identity(library)}\0{card}\0{channel}", what=what)


def _journal_lock(path: Path) -> RunLock:
    return RunLock(
        name=f"journal\0{os.path.normcase(path.resolve())}",
        what=Phrase("the journal {journal}", journal=printable(str(path))),
    )


def recorded_again(request: RunRequest) -> RunRequest | Refusal:
    """Read the journal that is continued again, now that it is locked: another run may have continued it since."""
    if request.options.resume is None:
        return request
    recorded = read_recorded_run(request.options.resume.path)
    if isinstance(recorded, Refusal):
        return recorded
    return replace(request, options=replace(request.options, resume=recorded))


def _identity(library: Library) -> str:
    """Return the same text for all names of a library's file; the name if there is no such file."""
    with suppress(OSError):
        if (file := file_of(library)) is not None and (found := file.stat()).st_ino:
            return f"{found.st_dev}:{found.st_ino}"
    return os.path.normcase(library.path)


def _enter(lock: RunLock, job: Path, held: ExitStack) -> Diagnostic | Refusal | None:
    """Take a lock until the stack is closed; return why not, or None."""
    try:
        taken = lock.acquire(str(job.resolve()))
    except OSError as error:
        return _refusal(lock, error)
    if taken is not None:
        held.callback(taken.release)
        return None
    return Diagnostic(rule=rules.IN_USE, span=NOWHERE, fields={"what": lock.what, "holder": lock.holder()})


def _refusal(lock: RunLock, error: OSError) -> Refusal:
    """Make the refusal of a run whose lock can't be taken."""
    reason = Phrase(
        "can't lock {what}: {reason}; without this lock two runs could use it at once. Let all users of this computer "
        "write to this folder, or delete it while no run is in progress",
        what=lock.what,
        reason=reason_of(error),
    )
    return Refusal(reason=reason, subject=str(LOCK_FOLDER))


# Files that all users share.


def _make_folder() -> None:
    """Create the folder of the locks, for all users: each may create files in it, and remove only their own."""
    with suppress(FileExistsError):
        LOCK_FOLDER.mkdir()
        if sys.platform != "win32":
            LOCK_FOLDER.chmod(0o1777)  # mkdir's own mode is cut by the umask.
    if not stat.S_ISDIR(LOCK_FOLDER.lstat().st_mode):
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(LOCK_FOLDER))


def _open_shared(path: Path) -> int:
    """Open a file that all users write; create it if it is missing.

    Linux refuses O_CREAT for a file of another user in a folder with the sticky bit (fs.protected_regular), so it is
    given only with O_EXCL. Links are not followed: anybody could have put one there.
    """
    flags = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    for left in reversed(range(_TRIES)):
        with suppress(FileNotFoundError):
            try:
                return os.open(path, flags)
            except PermissionError:
                if not left:
                    raise
                time.sleep(_SLEEP_S)  # Its creator may be about to change its mode.
                continue
        with suppress(FileExistsError):
            descriptor = os.open(path, flags | os.O_CREAT | os.O_EXCL, 0o666)
            if sys.platform != "win32":
                os.fchmod(descriptor, 0o666)
            return descriptor
    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))


def _write_shared(path: Path, text: bytes) -> None:
    """Write a file that all users read."""
    descriptor = _open_shared(path)
    try:
        if os.fstat(descriptor).st_nlink == 1:  # With a second name it may be another file of this user.
            os.ftruncate(descriptor, 0)
            os.write(descriptor, text)
    finally:
        os.close(descriptor)


def _read_shared(path: Path) -> bytes:
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    try:
        return os.read(descriptor, _HOLDER_BYTES)
    finally:
        os.close(descriptor)


def _is_at(descriptor: int, path: Path) -> bool:
    """Return whether an open file is still the one at its path: its last holder may have removed it."""
    if sys.platform == "win32":  # An open file can't be removed.
        return True
    try:
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    except FileNotFoundError:
        return False
