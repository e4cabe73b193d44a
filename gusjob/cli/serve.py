"""A page served to browsers on this computer, which load it anew when it changes."""

from __future__ import annotations

import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

EVENTS = "/events"
_HEARTBEAT_S = 10.0
"""A browser that is gone is noticed by a line that can't be sent."""

_WAITING = b"<!DOCTYPE html><meta charset=utf-8><title>gusjob</title><p>The page is not ready yet; load it again."


class PageServer:
    """Serves one page on the loopback address, to nobody else.

    A name that points here from elsewhere (DNS rebinding) is refused: only this address and localhost are answered.
    """

    def __init__(self, port: int = 0) -> None:
        """Listen; port 0 takes any that is free. Raises OSError."""
        self._page = _WAITING
        self._version = 0
        self._changed = threading.Condition()
        self._server = ThreadingHTTPServer(("127.0.0.1", port), self._handler())
        self._server.daemon_threads = True
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self._server.server_port}/"

    def show(self, page: bytes) -> None:
        """Serve another page from now on, and tell browsers."""
        with self._changed:
            self._page = page
            self._version += 1
            self._changed.notify_all()

    def close(self) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._server.server_close()

    def _wait(self, seen: int) -> int:
        """The page's version, as soon as it is another than the one that was seen, or some time later."""
        with self._changed:
            self._changed.wait_for(lambda: self._version != seen, timeout=_HEARTBEAT_S)
            return self._version

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        served = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                port = served._server.server_port
                if self.headers.get("Host") not in (f"127.0.0.1:{port}", f"localhost:{port}"):
                    self.send_error(HTTPStatus.FORBIDDEN)
                elif self.path == "/":
                    self._send_page(served._page)
                elif self.path == EVENTS:
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
                self.wfile.write(page)

            def _send_events(self) -> None:
                self.send_response(HTTPStatus.OK)
                self.send_header("Content-Type", "text/event-stream")
                self.send_header("Cache-Control", "no-store")
                self.end_headers()
                seen = served._version
                try:
                    while True:
                        version = served._wait(seen)
                        self.wfile.write(b"data: changed\n\n" if version != seen else b":\n\n")
                        self.wfile.flush()
                        seen = version
                except OSError:  # The browser is gone.
                    return

            def log_message(self, *_said: object) -> None:
                """The terminal is for the report."""

        return Handler
