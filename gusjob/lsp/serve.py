"""Run the language server over standard input and output or a TCP port."""

from __future__ import annotations

import gc
import logging
import sys
from contextlib import suppress
from typing import BinaryIO, cast

from gusjob.lsp.handlers import make_server

HOST = "127.0.0.1"


class _Pipe:
    """Standard output, without errors if the client has ended: the end of the input ends the server."""

    def __init__(self, stdout: BinaryIO) -> None:
        self._stdout = stdout

    def write(self, data: bytes) -> int:
        with suppress(OSError, ValueError):
            self._stdout.write(data)
        return len(data)

    def flush(self) -> None:
        with suppress(OSError, ValueError):
            self._stdout.flush()

    def close(self) -> None:
        with suppress(OSError, ValueError):
            self._stdout.close()


def _configure_process() -> None:
    """Silence logging and make garbage collection rare.

    Errors go to the client; nobody reads standard error. A check makes many objects and hardly any cycles: collecting
    them would take longer than the check.
    """
    gc.freeze()
    gc.set_threshold(200_000, 50, 100)
    for name in ("pygls", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def serve_pipes(stdin: BinaryIO, stdout: BinaryIO, *, follow: bool = False) -> int:
    """Serve over standard input and output until the client ends the server or has ended itself.

    Args:
        stdin: Standard input.
        stdout: Standard output.
        follow: Use the editor's language.

    Returns:
        Exit status (LSP 3.17, exit): 0 after a shutdown request, else 1.
    """
    _configure_process()
    server = make_server(follow=follow)
    server.start_io(stdin, cast(BinaryIO, _Pipe(stdout)))
    return 0 if server.shutdown_requested else 1


def serve_port(port: int, *, follow: bool = False) -> int:
    """Serve one client on this computer over a port; otherwise as `serve_pipes`.

    Raises:
        OSError: The port is not available.
    """
    _configure_process()
    server = make_server(follow=follow)
    with suppress(SystemExit):
        server.start_tcp(HOST, port)
    return 0 if server.shutdown_requested else 1


if sys.platform == "win32":  # asyncio would print a traceback when a client's pipe breaks.
    logging.getLogger("asyncio.windows_events").setLevel(logging.CRITICAL + 1)
