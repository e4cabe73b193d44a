"""The handlers of the editor's requests and notifications."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar

from lsprotocol import types as lsp

from gusjob.i18n.language import language_of, set_language
from gusjob.lsp.completion import completions
from gusjob.lsp.definition import definition
from gusjob.lsp.document_symbols import document_symbols
from gusjob.lsp.edits import format_edits, quick_fixes
from gusjob.lsp.hover import hover
from gusjob.lsp.server import JobLanguageServer

T = TypeVar("T")


def make_server(*, follow: bool = False) -> JobLanguageServer:
    """Make a server with all its handlers. `follow`: use the editor's language."""
    server = JobLanguageServer()

    @server.feature(lsp.INITIALIZE)
    def initialize(params: lsp.InitializeParams) -> None:
        if follow and params.locale:
            set_language(language_of(params.locale))

    server.feature(lsp.TEXT_DOCUMENT_DID_SAVE)(_did_save)
    server.feature(lsp.WORKSPACE_DID_CHANGE_WATCHED_FILES)(_did_change_watched_files)
    server.feature(lsp.SHUTDOWN)(_shutdown)
    server.feature(lsp.TEXT_DOCUMENT_HOVER)(_hover)
    triggers = lsp.CompletionOptions(trigger_characters=[" ", '"', "/", "("])
    server.feature(lsp.TEXT_DOCUMENT_COMPLETION, triggers)(_completion)
    server.feature(lsp.TEXT_DOCUMENT_DEFINITION)(_definition)
    server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_SYMBOL)(_document_symbol)
    server.feature(lsp.TEXT_DOCUMENT_FORMATTING)(_formatting)
    kinds = lsp.CodeActionOptions(code_action_kinds=[lsp.CodeActionKind.QuickFix])
    server.feature(lsp.TEXT_DOCUMENT_CODE_ACTION, kinds)(_code_action)
    return server


def _did_save(ls: JobLanguageServer, params: lsp.DidSaveTextDocumentParams) -> None:
    ls.check_again(params.text_document.uri)


def _did_change_watched_files(ls: JobLanguageServer, _params: lsp.DidChangeWatchedFilesParams) -> None:
    for uri in ls.documents:
        ls.check_again(uri)


def _shutdown(ls: JobLanguageServer, _params: None) -> None:
    ls.shutdown_requested = True


async def _hover(ls: JobLanguageServer, params: lsp.HoverParams) -> lsp.Hover | None:
    query = ls.query(params.text_document.uri)
    return None if query is None else await _in_executor(hover, query, params.position)


async def _completion(ls: JobLanguageServer, params: lsp.CompletionParams) -> lsp.CompletionList | None:
    query = ls.query(params.text_document.uri)
    return None if query is None else await _in_executor(completions, query, params.position)


async def _definition(ls: JobLanguageServer, params: lsp.DefinitionParams) -> list[lsp.Location] | None:
    query = ls.query(params.text_document.uri)
    return None if query is None else await _in_executor(definition, query, params.position)


async def _document_symbol(
    ls: JobLanguageServer, params: lsp.DocumentSymbolParams
) -> list[lsp.DocumentSymbol] | list[lsp.SymbolInformation] | None:
    query = ls.query(params.text_document.uri)
    if query is None:
        return None
    client = ls.client_capabilities.text_document
    nested = bool(client and client.document_symbol and client.document_symbol.hierarchical_document_symbol_support)
    return await _in_executor(document_symbols, query, nested)


async def _formatting(ls: JobLanguageServer, params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit] | None:
    query = ls.query(params.text_document.uri)
    if query is None:
        return None
    edits = await _in_executor(format_edits, query)
    document = ls.documents.get(params.text_document.uri)
    return edits if document is not None and document.text is query.task.text else None


async def _code_action(ls: JobLanguageServer, params: lsp.CodeActionParams) -> list[lsp.CodeAction] | None:
    query = ls.query(params.text_document.uri)
    return None if query is None else await _in_executor(quick_fixes, query, params.range)


async def _in_executor(function: Callable[..., T], *arguments: Any) -> T:
    """Call a function outside of the event loop: with a large file it takes some time."""
    return await asyncio.get_running_loop().run_in_executor(None, function, *arguments)
