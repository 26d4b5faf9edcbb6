"""HTTP and WebSocket around a hub: who is let through, the routes, and what each page is sent."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import functools
import secrets
import tempfile
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import parse_qs

from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocketDisconnect

from flinders.core.files import reason
from flinders.errors import DocumentError, FitError, FlindersError, LinkError, NotSent, OutputError, UsageError
from flinders.live.access import HEADERS, Gate, Tokens, cookie_of, set_cookie, shown_name
from flinders.live.hub import UPLOAD_BYTES, Hub, Page
from flinders.live.messages import Notice, encode, parse
from flinders.live.page_state import points, session_state
from flinders.live.session import (
    GotPrevious,
    Opened,
    Requested,
    Session,
)
from flinders.report.html_file import joined

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from starlette.requests import Request
    from starlette.types import ASGIApp, Message, Receive, Scope, Send
    from starlette.websockets import WebSocket

    from flinders.core.calibration_file import Provenance
    from flinders.live.evaluation import Finished

STATIC: Final = Path(__file__).resolve().parent.parent / "static"
SCRIPTS: Final[dict[str, tuple[str, ...]]] = {"app.js": (), "views/scene.js": ("Scene",)}
"""Modules that are sent with all that they import, and what they export: two answers instead of twenty-five."""
STATE_S: Final = 0.2
"""From one state to the next, unless something was asked for."""
MOST_PAGES: Final = 20
CALIBRATION_BYTES: Final = 4 << 20


class Guard:
    """Lets through what may be let through, and puts the headers on every answer; see `access`."""

    def __init__(self, app: ASGIApp, gate: Gate, tokens: Tokens | None, say: Callable[[str], None]) -> None:
        self._app, self._gate, self._tokens, self._say = app, gate, tokens, say

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As ASGI has it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        is_socket = scope["type"] == "websocket"
        refusal = self._gate.refusal(
            host=headers.get("host"),
            origin=headers.get("origin"),
            needs_origin=is_socket or scope.get("method") not in ("GET", "HEAD"),
        )
        answer = None if refusal is None else _answer(refusal, 403)
        if answer is None and self._tokens is not None:
            answer = self._without_cookie(scope, headers)
        if answer is None and is_socket:
            await self._app(scope, receive, send)
        elif answer is None:
            await self._answered(scope, receive, _with_headers(send))
        elif is_socket:
            await _refuse_socket(receive, send)
        else:
            await answer(scope, receive, _with_headers(send))

    async def _answered(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; one that the browser has given up, or that is under way at the end, is no fault."""
        try:
            await self._app(scope, receive, send)
        except ClientDisconnect:
            return
        except asyncio.CancelledError:
            with contextlib.suppress(Exception):
                await _answer("flinders live has been stopped", 503)(scope, receive, send)

    def _without_cookie(self, scope: Scope, headers: Headers) -> Response | None:
        """What a browser without a cookie gets: one for a token, or a refusal."""
        if self._tokens is None or self._tokens.knows(cookie_of(headers.get("cookie"), self._gate.port)):
            return None
        shown = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        cookie = self._tokens.redeem(shown) if shown and scope["type"] == "http" and scope["path"] == "/" else None
        if cookie is None:
            return _answer("open the address that flinders live prints, with its token; each works once", 401)
        self._say(f"for another browser: http://HOST:{self._gate.port}/?token={self._tokens.current}")
        return Response(status_code=303, headers={"Location": "/", "Set-Cookie": set_cookie(self._gate.port, cookie)})


def _with_headers(send: Send) -> Send:
    """Put the headers of `access` on the answer; an answer may be stricter."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            names = {name.lower() for name, _ in message.get("headers", [])}
            more = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
            message["headers"] = [*message.get("headers", []), *(pair for pair in more if pair[0] not in names)]
        await send(message)

    return sending


async def _refuse_socket(receive: Receive, send: Send) -> None:
    """Refuse a WebSocket before it is one: the browser gets 403."""
    await receive()
    await send({"type": "websocket.close", "code": 1008})


def _answer(words: str, status: int) -> Response:
    return JSONResponse({"words": words}, status_code=status)


def _refused(error: FlindersError) -> Response:
    """An error as an answer: what was asked for is not there, cannot be read, or cannot be done now."""
    status = {2: 400, 5: 422}.get(error.exit_code, 409)
    return JSONResponse({"words": str(error), "code": error.code}, status_code=status)


def application(hub: Hub, gate: Gate, tokens: Tokens | None = None, say: Callable[[str], None] = print) -> ASGIApp:
    """Put routes and guard around a hub.

    Parameters
    ----------
    hub : Hub
    gate : Gate
    tokens : Tokens, optional
        Asked for by each browser, where given.
    say : callable
        Told the next token.
    """

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        running = asyncio.get_running_loop().create_task(hub.run())
        try:
            yield
        finally:
            running.cancel()
            await hub.stop()

    routes = [
        Route("/", _index),
        WebSocketRoute("/socket", _socket),
        Route("/calibration.json", _calibration),
        Route("/session.csv", _recording),
        Route("/report.html", _report),
        Route("/export/{target}", _export),
        Route("/open", _open, methods=["POST"]),
        Route("/previous", _previous, methods=["POST"]),
        Route("/send", _send, methods=["POST"]),
        *(Route(f"/static/{entry}", _script) for entry in SCRIPTS),
        Mount("/static", StaticFiles(directory=STATIC, check_dir=False)),
    ]
    app = Starlette(routes=routes, lifespan=lifespan, exception_handlers={FlindersError: _on_error})
    app.state.hub = hub
    return Guard(app, gate, tokens, say)


async def _on_error(_: Request, error: Exception) -> Response:
    return _refused(error) if isinstance(error, FlindersError) else _answer(str(error), 500)


async def _index(_: Request) -> Response:
    page = STATIC / "index.html"
    if not page.exists():
        return PlainTextResponse("the page is missing from this installation: install Flinders again", 500)
    return FileResponse(page, media_type="text/html; charset=utf-8")


def _script(request: Request) -> Response:
    """One of the page's modules, joined; without it, as without the 3-D view, the page knows what to do."""
    entry = request.url.path.removeprefix("/static/")
    try:
        return Response(_joined(entry), media_type="text/javascript; charset=utf-8")
    except FileNotFoundError:
        return _answer(f"{entry} is missing from this installation", 404)


@functools.cache
def _joined(entry: str) -> str:
    return joined(entry, exported=SCRIPTS[entry])


async def _calibration(request: Request) -> Response:
    """The calibration file of all readings."""
    from flinders.core.calibration_file import dumps

    hub: Hub = request.app.state.hub
    finished = await hub.final()
    content = dumps(finished.fit.to_document(_provenance(finished)))
    return _download(content.encode(), "calibration.json", "application/json")


async def _recording(request: Request) -> Response:
    """The file of the session, as it is."""
    hub: Hub = request.app.state.hub
    if hub.session.opened is not None:
        return _answer("a log is shown, which you have already: go back to live to save the session", 409)
    if not hub.supply.path.exists():
        return _answer("nothing has been recorded yet", 404)
    return FileResponse(hub.supply.path, media_type="text/csv", filename=hub.supply.path.name)


async def _report(request: Request) -> Response:
    """The report, as one file."""
    from flinders.report.html import page

    hub: Hub = request.app.state.hub
    finished = await hub.final()
    if isinstance(finished.outcome, FlindersError) and not isinstance(finished.outcome, FitError):
        raise finished.outcome
    text = await asyncio.to_thread(page, finished.outcome, finished.recording, provenance=_provenance(finished))
    return _download(text.encode(), "report.html", "text/html; charset=utf-8")


def _provenance(finished: Finished) -> Provenance:
    """Which release made a calibration, when, of which file."""
    from flinders.core.calibration_file import Provenance

    return Provenance(flinders=version("flinders"), date=datetime.now(UTC).replace(microsecond=0), files=finished.files)


async def _export(request: Request) -> Response:
    """The calibration for a target: its text with what to know about it, or the file."""
    from flinders.targets import find

    hub: Hub = request.app.state.hub
    try:
        row = find(request.path_params["target"])
    except UsageError as error:
        return _answer(str(error), 404)
    is_preview = "application/json" in request.headers.get("accept", "")
    finished = await hub.final()
    calibration, about = finished.fit.calibration, finished.about
    try:
        export = await asyncio.to_thread(row.render, calibration, about=about)
    except FlindersError as error:
        if is_preview:  # looking whether a target can hold it is no mistake of the page
            return JSONResponse({"refusal": str(error)})
        raise
    filename = f"{row.name}{row.suffix}"
    content = export.text.encode() if export.data is None else export.data
    if is_preview:
        binary = None if export.data is None else base64.b64encode(export.data).decode()
        fields = {"text": export.text, "filename": filename, "warnings": [*export.warnings, *finished.limits]}
        return JSONResponse({**fields, "checked": export.checked, "binary_base64": binary})
    kind = "text/plain; charset=utf-8" if export.data is None else "application/octet-stream"
    return _download(content, filename, kind)


def _download(content: bytes, filename: str, kind: str) -> Response:
    return Response(content, media_type=kind, headers={"Content-Disposition": f'attachment; filename="{filename}"'})


async def _open(request: Request) -> Response:
    """Open a log that was dropped on the page: its bytes go to a file of our own, which is read and deleted."""
    from flinders.live.session_file import load

    hub: Hub = request.app.state.hub
    name = shown_name(request.query_params.get("name", ""))
    with tempfile.TemporaryDirectory(prefix="flinders-") as folder:
        path = Path(folder) / f"dropped-{secrets.token_hex(4)}"
        received = await _saved(request, path)
        if received is None:
            return _answer(f"{name} is larger than {UPLOAD_BYTES >> 20} MB: calibrate it with flinders calibrate", 413)
        try:
            series, words, _ = await asyncio.to_thread(load, path, name)
        except FlindersError as error:
            words = str(error).replace(str(path), name).replace(path.name, name)
            return JSONResponse({"words": words, "code": error.code}, status_code=422)
    hub.take(Opened(hub.now, name, series, words))
    return JSONResponse({"words": words})


async def _saved(request: Request, path: Path) -> int | None:
    """Write a body to a file as it comes; None where it is too large."""
    size = 0
    try:
        with path.open("wb") as file:
            async for chunk in request.stream():
                size += len(chunk)
                if size > UPLOAD_BYTES:
                    return None
                file.write(chunk)
    except OSError as error:
        raise OutputError(f"a file for what was dropped cannot be written: {reason(error)}") from None
    return size


async def _previous(request: Request) -> Response:
    """Take a calibration file to compare with."""
    from flinders.core.calibration_file import loads
    from flinders.fitting.result import Fit

    hub: Hub = request.app.state.hub
    name = shown_name(request.query_params.get("name", ""))
    content = b""
    async for chunk in request.stream():
        content += chunk
        if len(content) > CALIBRATION_BYTES:
            return _answer(f"{name} is larger than {CALIBRATION_BYTES >> 20} MB: that is no calibration file", 413)
    try:
        previous = Fit.from_document(loads(content, source=name), name=name)
    except DocumentError as error:
        return _refused(error)
    hub.take(GotPrevious(hub.now, previous))
    return JSONResponse({"words": f"compared with {name}"})


async def _send(request: Request) -> Response:
    """Send the calibration to the board that the readings come from."""
    from flinders.live import motioncal
    from flinders.targets.motioncal import MotionCalPacket

    hub: Hub = request.app.state.hub
    board = hub.supply.board
    if board is None:
        raise LinkError(
            "this source takes no calibration: save it and use flinders send, or paste what the export shows"
        )
    _refuse_a_log(hub.session)
    finished = await hub.final()
    _refuse_a_log(hub.session)
    if finished.key < hub.session.live.since:
        return _answer("the session was begun anew meanwhile: look at the new calibration, and send that", 409)
    packet = MotionCalPacket.of(finished.fit.calibration)
    confirmed = await hub.on_feed(lambda: motioncal.send(board, packet, boot=0.0))
    return JSONResponse({"words": f"{board.name}: {confirmed}"})


def _refuse_a_log(session: Session) -> None:
    """See that what is shown is the calibration of the board, and not of the sensor that a log is of."""
    if session.opened is not None:
        raise NotSent(
            f"{session.opened_name} is shown, and its calibration is not this board's: go back to live, and send then"
        )


async def _socket(socket: WebSocket) -> None:
    """One page: two tasks, one that listens and one that tells."""
    hub: Hub = socket.app.state.hub
    await socket.accept()
    if len(hub.pages) >= MOST_PAGES:
        await socket.close(1013, f"{MOST_PAGES} pages are open: close one")
        return
    page = Page()
    hub.pages.add(page)
    telling = asyncio.get_running_loop().create_task(_tell(socket, hub, page))
    try:
        await _listen(socket, hub, page)
    except WebSocketDisconnect:
        pass
    finally:
        hub.pages.discard(page)
        telling.cancel()
        with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
            await telling


async def _listen(socket: WebSocket, hub: Hub, page: Page) -> None:
    """Take what a page asks for; what is no message changes nothing."""
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
        text = message.get("text")
        try:
            if text is None:
                raise UsageError("a page sends text, and this is not")  # noqa: TRY301 - answered like any other
            hub.take(Requested(hub.now, parse(text)))
        except UsageError as error:
            page.notices.append(Notice("error", str(error)))
        page.wake.set()


async def _tell(socket: WebSocket, hub: Hub, page: Page) -> None:
    """Send a page what is new: notices, fit, state and points, the newest of each."""
    hello = hub.hello()
    page.fit_revision, page.state_revision = hub.fit_message.revision, hello.state.revision
    await socket.send_text(encode(hello))
    while True:
        while page.notices:
            await socket.send_text(encode(page.notices.popleft()))
        if hub.fit_message.revision != page.fit_revision:
            page.fit_revision = hub.fit_message.revision
            await socket.send_text(encode(hub.fit_message))
        if _is_state_due(hub, page):
            page.is_urgent, page.stated_at = False, hub.now
            newest = session_state(hub.session)
            page.state_revision = newest.revision
            await socket.send_text(encode(newest))
        frame, cursor = points(hub.session, page.cursor)
        if frame is not None:
            await socket.send_bytes(frame)
            page.cursor = cursor
        page.wake.clear()
        await page.wake.wait()


def _is_state_due(hub: Hub, page: Page) -> bool:
    """Whether a page needs the state: when something was done at once, else five times a second; a silence, too."""
    since = hub.now - page.stated_at
    if page.is_urgent:
        return True
    return since >= STATE_S and (hub.session.revision != page.state_revision or since >= 1.0)
