"""A page served to browsers on this computer, which load it anew when it changes."""

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
"""A browser that is gone is noticed by a line that can't be sent."""

_WAITING = "<!DOCTYPE html>{html}<meta charset=utf-8><title>gusjob</title><p>{text}"


def _waiting() -> bytes:
    """What is served before there is a page."""
    html = "" if language() == "en" else "<html lang=zh-CN>"
    return _WAITING.format(html=html, text=localized(Phrase("The page is not ready yet; load it again."))).encode()


class _QuietServer(ThreadingHTTPServer):
    """Says nothing of a browser that goes away in the middle: the terminal is for the report."""

    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class PageServer:
    """Serves one page on the loopback address, to nobody else.

    A name that points here from elsewhere (DNS rebinding) is refused: only this address and localhost are answered.
    """

    def __init__(self, port: int = 0) -> None:
        """Listen; port 0 takes any that is free. Raises OSError."""
        self._page = _waiting()
        self._shown = ""
        self._changed = threading.Condition()
        self._server = _QuietServer(("127.0.0.1", port), self._handler())
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self._server.server_port}/"

    def new_events(self) -> str:
        """The path at which the next page is told that it is old. No other page, nor one served before, has it."""
        return _EVENTS + secrets.token_hex(8)

    def show(self, page: bytes, events: str) -> None:
        """Serve another page from now on, and tell browsers."""
        with self._changed:
            self._page, self._shown = page, events
            self._changed.notify_all()

    def close(self) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._server.server_close()

    def _is_old(self, events: str) -> bool:
        """Whether a page is another than the one that is served: as soon as it is, or after some time."""
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

            def log_message(self, *_said: object) -> None:
                """The terminal is for the report."""

        return Handler
