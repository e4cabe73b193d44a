"""A server of one page for browsers on this computer, which reload it when it changes."""

from __future__ import annotations

import secrets
import sys
import threading
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from gusjob.i18n.language import language
from gusjob.i18n.phrases import Phrase, localized

_EVENTS = "/events/"
_HEARTBEAT_S = 10.0
"""Interval of lines that are sent to detect browsers that have closed the connection."""

_WAITING = "<!DOCTYPE html>{html}<meta charset=utf-8><title>gusjob</title><p>{text}"


def _waiting() -> bytes:
    """Return the page that is served before the first report."""
    html = "" if language() == "en" else "<html lang=zh-CN>"
    return _WAITING.format(html=html, text=localized(Phrase("The page is not ready yet; reload it."))).encode()


class _QuietServer(ThreadingHTTPServer):
    """Ignores browsers that close the connection: the terminal is for the report."""

    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class PageServer:
    """Serves one page on the loopback address only.

    Requests with another host name than the address or localhost are refused, against DNS rebinding.
    """

    def __init__(self, port: int = 0) -> None:
        """Listen.

        Args:
            port: 0 for any free port.

        Raises:
            OSError: The port is not available.
        """
        self._page = _waiting()
        self._shown = ""
        self._changed = threading.Condition()
        self._server = _QuietServer(("127.0.0.1", port), self._handler())
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self._server.server_port}/"

    def new_events(self) -> str:
        """Return a new path for the event that announces the end of the next page; no other page has it."""
        return _EVENTS + secrets.token_hex(8)

    def show(self, page: bytes, events: str) -> None:
        """Serve another page from now on, and notify browsers."""
        with self._changed:
            self._page, self._shown = page, events
            self._changed.notify_all()

    def close(self) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._server.server_close()

    def _is_old(self, events: str) -> bool:
        """Return whether a page is outdated, as soon as it is or after the heartbeat interval."""
        with self._changed:
            return self._changed.wait_for(lambda: self._shown != events, timeout=_HEARTBEAT_S)

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        served = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                port = served._server.server_port
                if self.headers.get("Host") not in (f"127.0.0.1:{port}", f"localhost:{port}"):
                    self.send_error(HTTPStatus.FORBIDDEN)
                elif self.path == "/":
                    self._send_page(served._page)
                elif self.path.startswith(_EVENTS):
                    self._send_events()
                else:
                    self.send_error(HTTPStatus.NOT_FOUND)

            def _send_page(self, page: bytes) -> None:
                self.send_response(HTTPStatus.OK)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(page)))
                self.send_header("Cache-Control", "no-store")
                self.send_header("X-Content-Type-Options", "nosniff")
                self.end_headers()
                with suppress(OSError):  # The browser is gone.
                    self.wfile.write(page)

            def _send_events(self) -> None:
                self.send_response(HTTPStatus.OK)
                self.send_header("Content-Type", "text/event-stream")
                self.send_header("Cache-Control", "no-store")
                self.end_headers()
                with suppress(OSError):  # The browser is gone.
                    while not served._is_old(self.path):
                        self.wfile.write(b":\n\n")
                        self.wfile.flush()
                    self.wfile.write(b"data: changed\n\n")

            def log_message(self, *_arguments: object) -> None:
                """The terminal is for the report."""

        return Handler
