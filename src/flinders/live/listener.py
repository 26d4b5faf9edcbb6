"""The address of the live page and the HTTP server behind it: uvicorn, with limits on slow connections."""

from __future__ import annotations

import contextlib
import logging
import signal
import socket
from typing import TYPE_CHECKING, Final

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from flinders.errors import LinkError
from flinders.live.messages import LONGEST

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Iterator

    from starlette.types import ASGIApp

STOPPING_S: Final = 1
"""Seconds that pages have to let go, when the server stops."""
HEAD_S: Final = 10.0
"""Seconds that the head of a request may take to come."""
MOST_CONNECTIONS: Final = 200
"""Open at one time; a further one is closed."""


def listening(host: str, port: int) -> socket.socket:
    """Open the socket to listen on; port 0 takes any that is free.

    Raises
    ------
    LinkError
        Where it is taken, or the address is not one of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host.strip("[]"), port))
        listener.listen()
    except (OSError, OverflowError) as error:
        listener.close()
        raise LinkError(_why_not(host, port, error)) from None
    return listener


def _why_not(host: str, port: int, error: Exception) -> str:
    import errno

    number = getattr(error, "errno", None)
    if number == errno.EADDRINUSE:
        return f"port {port} is taken, perhaps by another flinders live: give another --port, or 0 for any"
    if number in (errno.EACCES, errno.EPERM):
        return f"port {port} is for the administrator: give a --port from 1024 on, or 0 for any"
    if isinstance(error, socket.gaierror) or number == errno.EADDRNOTAVAIL:
        return f"this machine has no address {host}: give --host 127.0.0.1, or 0.0.0.0 for all it has"
    return f"{host} port {port} cannot be opened: {error}"


def _is_ours(record: logging.LogRecord) -> bool:
    """Whether uvicorn tells of a fault; that it stops waiting for somebody at the end is none."""
    return "graceful shutdown exceeded" not in str(record.msg)


class _Server(uvicorn.Server):
    """Stops on a signal, cleanly, and is then done; a second one ends it at once."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
        before = {}
        with contextlib.suppress(ValueError):  # not the main thread, which alone gets signals
            before = {name: signal.signal(getattr(signal, name), self._stop) for name in names}
        try:
            yield
        finally:
            for name, handler in before.items():
                signal.signal(getattr(signal, name), handler)

    def _stop(self, _number: int, _frame: object) -> None:
        self.force_exit = self.should_exit
        self.should_exit = True


class _Patient(H11Protocol):
    """A connection that has to say what it wants before long, so that none can be held open for nothing."""

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take the connection, unless there are too many."""
        super().connection_made(transport)
        if len(self.connections) > MOST_CONNECTIONS:
            transport.abort()
        else:
            self._watch()

    def data_received(self, data: bytes) -> None:
        """Take what came, and see whether the head of a request is whole."""
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
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
    """Serve until Ctrl-C, or whatever else ends a program from outside."""
    server_of(app).run(sockets=[listener])


def server_of(app: ASGIApp) -> uvicorn.Server:
    """A server that waits for nobody for long."""
    config = uvicorn.Config(
        app,
        http=_Patient,
        ws="websockets-sansio",
        ws_max_size=LONGEST,
        ws_per_message_deflate=False,
        lifespan="on",
        log_config=None,
        log_level="error",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=STOPPING_S,
        h11_max_incomplete_event_size=32_768,
    )
    logging.getLogger("uvicorn.error").addFilter(_is_ours)
    return _Server(config)
