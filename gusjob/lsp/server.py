"""The state of the language server: open documents, their diagnostics, and the tasks that check them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from lsprotocol import types as lsp
from msgspec import Struct
from pygls.lsp.server import LanguageServer
from pygls.protocol import JsonRPCNotification, LanguageServerProtocol, default_converter, lsp_method

from gusjob.lsp.diagnostics import Diagnosis
from gusjob.lsp.query import Query
from gusjob.lsp.text import Text, utf8
from gusjob.lsp.worker import Task, TaskResult, Worker
from gusjob.lsp.workspace import path_of
from gusjob.version import __version__

T = TypeVar("T")

_INVALID_PARAMS = -32602


class OpenDocument(Struct):
    """An open file.

    Attributes:
        version: The editor's number of the text.
        task_number: Number of the newest task of the file.
        diagnosis: The newest diagnosis.
        diagnosed_text: The text of that diagnosis.
    """

    uri: str
    path: Path | None
    text: Text
    version: int
    task_number: int = 0
    diagnosis: Diagnosis | None = None
    diagnosed_text: Text | None = None

    @property
    def key(self) -> str:
        """The resolved path, by which other files refer to it; "" if it has no file."""
        return "" if self.path is None else str(_resolved(self.path))


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # A loop of links.
        return path


class JobProtocol(LanguageServerProtocol):
    """The protocol of pygls with two changes.

    Texts are held as bytes, so that a keystroke in a large text is cheap. A malformed message gets an error response
    instead of an exception.
    """

    _server: JobLanguageServer

    @lsp_method(lsp.TEXT_DOCUMENT_DID_OPEN)
    def lsp_text_document__did_open(self, params: lsp.DidOpenTextDocumentParams) -> None:
        """Open a text."""
        self._server.opened(params.text_document)

    @lsp_method(lsp.TEXT_DOCUMENT_DID_CHANGE)
    def lsp_text_document__did_change(self, params: lsp.DidChangeTextDocumentParams) -> None:
        """Change a text."""
        self._server.changed(params)

    @lsp_method(lsp.TEXT_DOCUMENT_DID_CLOSE)
    def lsp_text_document__did_close(self, params: lsp.DidCloseTextDocumentParams) -> None:
        """Close a text."""
        self._server.closed(params.text_document.uri)

    def structure_message(self, data: dict[str, Any]) -> Any:
        """Parse a message. Answer a malformed request with an error, and ignore a malformed notification."""
        try:
            return super().structure_message(data)
        except Exception as error:  # noqa: BLE001  (a client may send anything)
            if "id" in data and "method" in data:
                reply = lsp.ResponseError(code=_INVALID_PARAMS, message=f"{data['method']}: wrong parameters: {error}")
                self._send_response(data["id"], error=reply)
            return JsonRPCNotification(method="$/nothing", jsonrpc=self.VERSION, params=None)


class JobLanguageServer(LanguageServer):
    """The open documents and their diagnostics.

    All methods run in the event loop; only the worker's checks run in its thread.
    """

    def __init__(self) -> None:
        """Start the worker; the server does not listen yet."""
        super().__init__("gusjob", __version__, protocol_cls=JobProtocol, converter_factory=default_converter)
        self.documents: dict[str, OpenDocument] = {}
        self.published: dict[str, dict[str, list[lsp.Diagnostic]]] = {}
        """Diagnostics by URI of their file, then by URI of the document that was checked."""
        self.shutdown_requested = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._worker = Worker(self._in_loop(self._checked), self._in_loop(self.check_again), self._in_loop(self._log))

    # Documents.

    @property
    def unit(self) -> lsp.PositionEncodingKind | str:
        """The unit of columns."""
        return self.server_capabilities.position_encoding or lsp.PositionEncodingKind.Utf16

    def opened(self, item: lsp.TextDocumentItem) -> None:
        """Add a document: from now on its text comes from the editor, not from the disk."""
        self._loop = asyncio.get_running_loop()
        text = Text(utf8(item.text), self.unit)
        document = OpenDocument(uri=item.uri, path=path_of(item.uri), text=text, version=item.version)
        self.documents[item.uri] = document
        self._submit_with_dependents(document)

    def changed(self, params: lsp.DidChangeTextDocumentParams) -> None:
        """Apply the edits of a document."""
        document = self.documents.get(params.text_document.uri)
        if document is None:
            return
        for change in params.content_changes:
            document.text = document.text.edited(change)
        document.version = params.text_document.version
        self._submit_with_dependents(document)

    def closed(self, uri: str) -> None:
        """Remove a document and its diagnostics: from now on its text comes from the disk."""
        document = self.documents.pop(uri, None)
        if document is None:
            return
        self._worker.forget(uri)
        self._replace(uri, {})
        self._submit_dependents(document)
        for name in document.diagnosis.files if document.diagnosis else ():
            for other in self.documents.values():
                if other.key == name:
                    self._submit(other)

    # Checking.

    def _submit_with_dependents(self, document: OpenDocument) -> None:
        self._submit(document)
        self._submit_dependents(document)

    def _submit_dependents(self, document: OpenDocument) -> None:
        """Check the open files that include this one again."""
        for other in self.documents.values():
            if other is not document and other.diagnosis is not None and _includes_file(other.diagnosis, document.key):
                self._submit(other)

    def _submit(self, document: OpenDocument) -> None:
        document.task_number += 1
        self._worker.submit(self.task(document))

    def task(self, document: OpenDocument) -> Task:
        """Return a task for a document, with the texts of all open documents."""
        others = [one for one in self.documents.values() if one.path is not None]
        return Task(
            uri=document.uri,
            number=document.task_number,
            path=document.path,
            text=document.text,
            open_texts={one.key: one.text.data for one in others},
            uris={one.key: one.uri for one in others},
            unit=self.unit,
        )

    def _in_loop(self, function: Callable[[T], None]) -> Callable[[T], None]:
        """Return a function for the worker's thread that calls `function` in the event loop."""

        def call(argument: T) -> None:
            if self._loop is not None:
                with suppress(RuntimeError):  # The loop has ended, and the process ends.
                    self._loop.call_soon_threadsafe(function, argument)

        return call

    def check_again(self, uri: str) -> None:
        """Check a document again, if it is open."""
        document = self.documents.get(uri)
        if document is not None:
            self._submit(document)

    def _log(self, message: str) -> None:
        """Write to the editor's log."""
        with suppress(OSError, ValueError):  # The client is gone.
            self.window_log_message(lsp.LogMessageParams(type=lsp.MessageType.Error, message=message))

    def _checked(self, result: TaskResult) -> None:
        """Publish a result, unless the text has changed since."""
        document = self.documents.get(result.task.uri)
        if document is None or result.task.number != document.task_number:
            return
        document.diagnosis, document.diagnosed_text = result.diagnosis, result.task.text
        self._replace(document.uri, result.published)

    def _replace(self, top: str, fresh: dict[str, list[lsp.Diagnostic]]) -> None:
        """Replace the diagnostics that an earlier check of the document `top` found, and publish them."""
        old = [uri for uri, by_top in self.published.items() if top in by_top]
        for uri in {*old, *fresh}:
            by_top = self.published.setdefault(uri, {})
            if uri in fresh:
                by_top[top] = fresh[uri]
            else:
                by_top.pop(top, None)
        for uri in sorted({*old, *fresh}):
            self._publish(uri)

    def _publish(self, uri: str) -> None:
        """Send all diagnostics of a file to the editor.

        A file that an open job includes is checked as a part of that job, not alone: it may depend on the job.
        """
        document = self.documents.get(uri)
        by_top = self.published[uri]
        tops = [top for top in by_top if top != uri and top in self.documents]
        if document is not None:
            tops = [top for top in tops if not self._includes(document, top)]
        chosen = tops or ([uri] if uri in by_top else [])
        found: list[lsp.Diagnostic] = []
        for top in chosen:
            found += [one for one in by_top[top] if one not in found]
        version = document.version if document is not None else None
        with suppress(OSError, ValueError):  # The client is gone.
            self.text_document_publish_diagnostics(
                lsp.PublishDiagnosticsParams(uri=uri, diagnostics=found, version=version)
            )
        if not by_top:
            del self.published[uri]

    def _includes(self, document: OpenDocument, uri: str) -> bool:
        other = self.documents.get(uri)
        return other is not None and document.diagnosis is not None and _includes_file(document.diagnosis, other.key)

    # Requests.

    def query(self, uri: str) -> Query | None:
        """Return the context of a request about a document; None if it is not open."""
        document = self.documents.get(uri)
        if document is None:
            return None
        tops = (one for one in self.documents.values() if one.diagnosis is not None and one is not document)
        top = next((one for one in tops if one.diagnosis and _includes_file(one.diagnosis, document.key)), document)
        current = document.diagnosis if document.diagnosed_text is document.text else None
        return Query(task=self.task(document), top=self.task(top), diagnosis=current)


def _includes_file(diagnosis: Diagnosis, key: str) -> bool:
    return bool(key) and key in diagnosis.files
