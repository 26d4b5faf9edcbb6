"""Address of the live page, its HTTP server, and access control.

A page of another site can make a browser connect to 127.0.0.1, also under a host name of that site. So a request has to
name this server as its host, and a request that changes state or opens a socket has to come from a page of this server.
On addresses other than the loopback, a request also needs a token, which only the terminal shows.

>>> gate = Gate.of("127.0.0.1", 8410)
>>> gate.refusal(host="127.0.0.1:8410", origin="http://127.0.0.1:8410", needs_origin=True) is None
True
>>> print(gate.refusal(host="evil.example:8410", origin=None, needs_origin=False))
this server is not evil.example:8410: open the address that flinders live prints
>>> print(gate.refusal(host="127.0.0.1:8410", origin="http://evil.example", needs_origin=True))
http://evil.example is another site: only pages of this server may do that
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hmac
import ipaddress
import logging
import re
import secrets
import signal
import socket
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self
from urllib.parse import urlsplit

import h11
import uvicorn
from starlette.datastructures import MutableHeaders
from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.websockets import WebSocketClose
from uvicorn.protocols.http.h11_impl import H11Protocol

from flinders.apps.live.messages import MAX_MESSAGE_BYTES
from flinders.errors import LinkError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from starlette.types import ASGIApp, Message, Receive, Scope, Send

CSP: Final = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: Final = {
    "Content-Security-Policy": CSP,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=(), usb=(), serial=()",
    "Cache-Control": "no-store",
}
"""Headers of every answer."""
MAX_NAME_LENGTH: Final = 100  # Largest number of characters of a file's name in messages
TOKEN_BYTES: Final = 16


@dataclass(frozen=True, slots=True)
class Gate:
    """Access control of a port: accepts requests that call the server by one of its names.

    An open gate listens on addresses that other machines reach, and accepts any numeric address as its name.
    """

    host: str
    port: int
    names: frozenset[str]
    is_open: bool

    @classmethod
    def of(cls, host: str, port: int, own_names: tuple[str, ...] = ()) -> Self:
        """Return the gate of a server that listens on `host`; `own_names` are the names of this machine."""
        names = {"127.0.0.1", "localhost", "::1", host.strip("[]").casefold()}
        is_open = not is_loopback(host)
        if is_open:
            names |= {name.casefold() for own in own_names if own for name in (own, f"{own}.local")}
        return cls(host, port, frozenset(names), is_open)

    def refusal(self, *, host: str | None, origin: str | None, needs_origin: bool) -> str | None:
        """Return the reason to refuse a request with these headers; None to accept it.

        A request that changes state or opens a socket needs an origin, which browsers always send with such requests.
        """
        if host is None or not self._is_own(host):
            return f"this server is not {host or 'without a name'}: open the address that flinders live prints"
        if origin is None:
            return "only pages of this server may do that, and the request names none" if needs_origin else None
        parts = urlsplit(origin)
        if parts.scheme != "http" or parts.path or parts.query or parts.netloc.casefold() != host.casefold():
            return f"{shown_name(origin)} is another site: only pages of this server may do that"
        return None

    def _is_own(self, host: str) -> bool:
        """Whether a Host header names this server."""
        match = re.fullmatch(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::(\d{1,5}))?", host)
        if not match or int(match[2] or 80) != self.port:
            return False
        name = match[1].strip("[]").casefold()
        return name in self.names or (self.is_open and is_address(name))


def own_names() -> tuple[str, ...]:
    """Names of this machine, with and without its domain."""
    name = socket.gethostname()
    return (name, name.partition(".")[0])


def page_addresses(host: str, port: int, token: str | None = None) -> list[str]:
    """Addresses of the page for a browser; one for each network if the server listens on all.

    >>> page_addresses("127.0.0.1", 8410), page_addresses("::1", 8410, "secret")
    (['http://127.0.0.1:8410/'], ['http://[::1]:8410/?token=secret'])
    """
    query = f"?token={token}" if token else ""
    hosts = _own_addresses() if host in ("0.0.0.0", "::") else [host]
    return [f"http://{f'[{shown}]' if ':' in shown else shown}:{port}/{query}" for shown in hosts]


def _own_addresses() -> list[str]:
    """Addresses of this machine on its networks, that for outgoing connections first; nothing is sent to find them."""
    addresses = dict.fromkeys([_outgoing_address(), *_named_addresses()])
    return [address for address in addresses if not is_loopback(address)] or ["127.0.0.1"]


def _outgoing_address() -> str:
    """Address of this machine for outgoing connections."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1"


def _named_addresses() -> list[str]:
    """Addresses to which the name of this machine resolves."""
    with contextlib.suppress(OSError):
        return [str(entry[4][0]) for entry in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)]
    return []


def is_loopback(host: str) -> bool:
    """Whether an address is reachable from this machine only.

    >>> is_loopback("127.0.0.1"), is_loopback("localhost"), is_loopback("0.0.0.0")
    (True, True, False)
    """
    return host.casefold() == "localhost" or (is_address(host) and ipaddress.ip_address(host.strip("[]")).is_loopback)


def is_address(name: str) -> bool:
    """Whether a host name is a numeric address, which no DNS server can redirect."""
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


@dataclass(slots=True)
class Tokens:
    """One-time tokens: each token is exchanged for a cookie once, and then replaced by a new token."""

    current: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES))
    _cookies: set[str] = field(default_factory=set)

    def redeem(self, token: str) -> str | None:
        """Return a cookie for the current token and replace the token; None for another token."""
        if not hmac.compare_digest(token.encode(), self.current.encode()):
            return None
        self.current = secrets.token_urlsafe(TOKEN_BYTES)
        cookie = secrets.token_urlsafe(TOKEN_BYTES)
        self._cookies.add(cookie)
        return cookie

    def is_issued(self, cookie: str | None) -> bool:
        """Whether this server has issued a cookie."""
        matches = [hmac.compare_digest((cookie or "").encode(), known.encode()) for known in self._cookies]
        return any(matches)


def cookie_name(port: int) -> str:
    """Name of this server's cookie, with the port, since browsers share cookies among all ports of a host."""
    return f"flinders-{port}"


def shown_name(name: str) -> str:
    r"""File name from a browser made safe to show: no folder, printable characters only, limited length.

    The name is never opened as a file.

    >>> shown_name("../../etc/pass\nwd.csv"), shown_name("")
    ('passwd.csv', 'a file')
    """
    last = re.split(r"[/\\]", name)[-1] if "://" not in name else name
    text = "".join(letter for letter in last if letter.isprintable()).strip()
    return text[:MAX_NAME_LENGTH] or "a file"


def answer(words: str, status: int, headers: Mapping[str, str] | None = None) -> Response:
    """Return an answer with a message for the user, as JSON."""
    return JSONResponse({"words": words}, status_code=status, headers=headers)


NO_TOKEN: Final = """<!doctype html>
<html lang="en-GB"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<meta name="color-scheme" content="dark light"><title>Flinders</title>
<h1>This address lacks its token</h1>
<p>Open the whole address that <code>flinders live</code> prints last: it ends in <code>?token=…</code>
<p>Each token admits one browser. The terminal prints the next one when it has been used.
"""
"""Page for a browser that sends no token."""


class Guard:
    """ASGI application with access control, and with `HEADERS` on every answer.

    If `tokens` is given, each browser needs a token. After a token was used, `say` is called with the address for
    another browser.
    """

    def __init__(self, app: ASGIApp, gate: Gate, tokens: Tokens | None, say: Callable[[str], None]) -> None:
        self._app, self._gate, self._tokens, self._say = app, gate, tokens, say

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request by ASGI; an aborted request, or one that is open at shutdown, is not an error."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refused = self._refusal_response(HTTPConnection(scope))
        if scope["type"] == "websocket":
            await (WebSocketClose(1008) if refused else self._app)(scope, receive, send)
            return
        send = _with_headers(send)
        try:
            await (refused or self._app)(scope, receive, send)
        except ClientDisconnect:
            return
        except asyncio.CancelledError:
            with contextlib.suppress(Exception):
                await answer("flinders live has been stopped", 503)(scope, receive, send)

    def _refusal_response(self, request: HTTPConnection) -> Response | None:
        """Return the answer to a refused request; None for an accepted one."""
        is_socket = request.scope["type"] == "websocket"
        refusal = self._gate.refusal(
            host=request.headers.get("host"),
            origin=request.headers.get("origin"),
            needs_origin=is_socket or request.scope["method"] not in ("GET", "HEAD"),
        )
        if refusal is not None:
            return answer(refusal, 403)
        name = cookie_name(self._gate.port)
        if self._tokens is None or self._tokens.is_issued(request.cookies.get(name)):
            return None
        shown = request.query_params.get("token", "")
        cookie = self._tokens.redeem(shown) if not is_socket and request.url.path == "/" else None
        if cookie is None:
            return _without_token(request)
        for address in page_addresses(self._gate.host, self._gate.port, self._tokens.current):
            self._say(f"for another browser: {address}")
        let_in = RedirectResponse("/", 303)
        let_in.set_cookie(name, cookie, httponly=True, samesite="strict")
        return let_in


def _without_token(request: HTTPConnection) -> Response:
    """Answer to a browser without a valid token: a page, or JSON if it did not request a page."""
    if request.scope["type"] == "websocket" or "text/html" not in request.headers.get("accept", ""):
        return answer("open the address that flinders live prints, with its token; each works once", 401)
    return HTMLResponse(NO_TOKEN, 401)


def _with_headers(send: Send) -> Send:
    """Wrap `send` so that `HEADERS` are added to the answer unless set."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return sending


SIGNALS: Final = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
STOPPING_S: Final = 1  # Longest wait for pages to disconnect when the server stops
HEAD_S: Final = 10.0  # Longest time to receive the head of a request
MAX_CONNECTIONS: Final = 200  # Largest number of connections at one time; further ones are closed


def open_listener(host: str, port: int) -> socket.socket:
    """Open the socket to listen on; port 0 means any free port. Raises `LinkError` with the reason if it fails."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host.strip("[]"), port))
        listener.listen()
    except (OSError, OverflowError) as error:
        listener.close()
        raise LinkError(_failure_words(host, port, error)) from None
    return listener


def _failure_words(host: str, port: int, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == errno.EADDRINUSE:
        return f"port {port} is taken, perhaps by another flinders live: give another --port, or 0 for any"
    if number in (errno.EACCES, errno.EPERM):
        return f"port {port} is for the administrator: give a --port from 1024 on, or 0 for any"
    if isinstance(error, socket.gaierror) or number == errno.EADDRNOTAVAIL:
        return f"this machine has no address {host}: give --host 127.0.0.1, or 0.0.0.0 for all it has"
    return f"{host} port {port} cannot be opened: {error}"


def _is_fault(record: logging.LogRecord) -> bool:
    """Whether a log record of uvicorn is a fault; an exceeded shutdown wait is not."""
    return "graceful shutdown exceeded" not in str(record.msg)


class _Server(uvicorn.Server):
    """Server that stops cleanly on a signal, and at once on a second signal."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        with contextlib.ExitStack() as before:
            with contextlib.suppress(ValueError):  # only the main thread receives signals
                for number in SIGNALS:
                    before.callback(signal.signal, number, signal.signal(number, self._stop))
            yield

    def _stop(self, _number: int, _frame: object) -> None:
        self.force_exit = self.should_exit
        self.should_exit = True


class _DeadlineProtocol(H11Protocol):
    """Connection with a deadline for the head of a request, so that idle connections are closed."""

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept the connection, unless there are too many."""
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS:
            transport.abort()
        else:
            self._watch()

    def data_received(self, data: bytes) -> None:
        """Process received bytes, and end the deadline once the head of a request is complete."""
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the deadline of a lost connection."""
        self._forget()
        super().connection_lost(exc)

    def _watch(self) -> None:
        if self.conn.their_state is not h11.IDLE:
            self._forget()
        elif self._deadline is None:
            self._deadline = self.loop.call_later(HEAD_S, self.transport.abort)

    def _forget(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
        self._deadline = None


def serve(app: ASGIApp, listener: socket.socket) -> None:
    """Serve until Ctrl-C or another terminating signal."""
    server_of(app).run(sockets=[listener])


def server_of(app: ASGIApp) -> uvicorn.Server:
    """Return the HTTP server of an application, which waits only briefly for clients when it stops."""
    config = uvicorn.Config(
        app,
        http=_DeadlineProtocol,
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False,
        lifespan="on",
        log_config=None,
        log_level="error",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=STOPPING_S,
        h11_max_incomplete_event_size=32_768,
    )
    logging.getLogger("uvicorn.error").addFilter(_is_fault)
    return _Server(config)
