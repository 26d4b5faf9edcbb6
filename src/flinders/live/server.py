"""HTTP and WebSocket around a hub: the routes, and what each page is sent."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import secrets
import tempfile
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Final

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocketDisconnect

from flinders.core.files import reason
from flinders.errors import (
    FitError,
    FlindersError,
    LinkError,
    NotSent,
    OutputError,
    UsageError,
    fault_words,
)
from flinders.live.access import Gate, Guard, Tokens, answer, shown_name
from flinders.live.hub import UPLOAD_BYTES, Hub, Page
from flinders.live.messages import FitMessage, Notice, encode, parse
from flinders.live.page_state import points, session_state
from flinders.live.session import GotPrevious, LiveSession, Opened, Requested
from flinders.report.html_file import joined

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator

    from starlette.requests import Request
    from starlette.types import ASGIApp
    from starlette.websockets import WebSocket

    from flinders.core.calibration_file import ProvenanceRecord
    from flinders.live.evaluation import Finished

STATIC: Final = Path(__file__).resolve().parent.parent / "static"
SCRIPTS: Final[dict[str, tuple[str, ...]]] = {"live.js": (), "views/scene.js": ("Scene",)}
"""Modules that are sent with all that they import, and what they export: two answers instead of twenty-five."""
STATE_S: Final = 0.2  # From one state to the next, unless something was asked for
MOST_PAGES: Final = 20
CALIBRATION_BYTES: Final = 4 << 20
STALLED_S: Final = 10.0  # Seconds that an upload may send nothing


@dataclass(slots=True)
class Uploads:
    """What is being uploaded: all of it together is no larger than one file may be, and files are read one by one."""

    size: int = 0
    reading: asyncio.Lock = field(default_factory=asyncio.Lock)

    @contextlib.contextmanager
    def counting(self) -> Iterator[Callable[[int], int]]:
        """Count the bytes of one upload until it is done with; the count returns how many they are by now."""
        mine = 0

        def count(size: int) -> int:
            nonlocal mine
            mine += size
            self.size += size
            return mine

        try:
            yield count
        finally:
            self.size -= mine


def application(hub: Hub, gate: Gate, tokens: Tokens | None = None, say: Callable[[str], None] = print) -> ASGIApp:
    """Put routes and guard around a hub; the rest is as `Guard` takes it."""

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
    handlers = dict.fromkeys((FlindersError, HTTPException, Exception), _on_error)
    app = Starlette(routes=routes, lifespan=lifespan, exception_handlers=handlers)
    app.state.hub, app.state.uploads = hub, Uploads()
    return Guard(app, gate, tokens, say)


async def _on_error(_: Request, error: Exception) -> Response:
    """An error as an answer: what was asked for is not there, cannot be read, or cannot be done now."""
    if isinstance(error, HTTPException):
        return answer(error.detail, error.status_code, error.headers)
    if not isinstance(error, FlindersError):
        return answer(fault_words(error), 500)
    status = {2: 400, 5: 422}.get(error.exit_code, 409)
    return JSONResponse({"words": error.message, "code": error.code}, status_code=status)


async def _index(_: Request) -> Response:
    page = STATIC / "index.html"
    if not page.exists():
        raise HTTPException(500, "the page is missing from this installation: install Flinders again")
    return FileResponse(page, media_type="text/html; charset=utf-8")


def _script(request: Request) -> Response:
    """One of the page's modules, joined; without it, as without the 3-D view, the page knows what to do."""
    entry = request.url.path.removeprefix("/static/")
    try:
        return Response(joined(entry, exported=SCRIPTS[entry]), media_type="text/javascript; charset=utf-8")
    except FileNotFoundError:
        raise HTTPException(404, f"{entry} is missing from this installation") from None


async def _calibration(request: Request) -> Response:
    """The calibration file of all readings."""
    from flinders.core.calibration_file import dumps

    hub: Hub = request.app.state.hub
    finished = await hub.final()
    content = dumps(finished.fit.to_document(_provenance(finished)))
    return _download(content.encode(), "calibration.json", "application/json")


async def _recording(request: Request) -> Response:
    """The file of the session, as it is now."""
    from flinders.live.transfers import snapshot

    hub: Hub = request.app.state.hub
    if hub.session.opened is not None:
        raise HTTPException(409, "a log is shown, which you have already: go back to the sensor to save the session")
    if not hub.supply.path.exists():
        raise HTTPException(404, "nothing has been recorded yet")
    return await asyncio.to_thread(snapshot, hub.supply.path)


async def _report(request: Request) -> Response:
    """The report, as one file."""
    from flinders.report.html import page

    hub: Hub = request.app.state.hub
    finished = await hub.final()
    if isinstance(finished.outcome, FlindersError) and not isinstance(finished.outcome, FitError):
        raise finished.outcome
    text = await asyncio.to_thread(page, finished.outcome, finished.recording, provenance=_provenance(finished))
    return _download(text.encode(), "report.html", "text/html; charset=utf-8")


def _provenance(finished: Finished) -> ProvenanceRecord:
    """Which release made a calibration, when, of which file."""
    from flinders.core.calibration_file import ProvenanceRecord

    return ProvenanceRecord(
        flinders=version("flinders"), date=datetime.now(UTC).replace(microsecond=0), files=finished.files
    )


async def _export(request: Request) -> Response:
    """The calibration for a target: its text with what to know about it, or the file."""
    from flinders.targets import find

    hub: Hub = request.app.state.hub
    try:
        row = find(request.path_params["target"])
    except UsageError as error:
        raise HTTPException(404, error.message) from None
    is_preview = "application/json" in request.headers.get("accept", "")
    finished = await hub.final()
    calibration, about = finished.fit.calibration, finished.about
    try:
        export = await asyncio.to_thread(row.render, calibration, about=about)
    except FlindersError as error:
        if is_preview:  # looking whether a target can hold it is no mistake of the page
            return JSONResponse({"refusal": error.message})
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
    """Open a log that was dropped on the page."""
    from flinders.live.transfers import load_upload

    hub: Hub = request.app.state.hub
    async with _dropped(request, UPLOAD_BYTES, "calibrate it with flinders calibrate") as (path, name):
        try:
            async with request.app.state.uploads.reading:
                series, words = await asyncio.to_thread(load_upload, path, name)
        except FlindersError as error:
            words = error.message.replace(str(path), name).replace(path.name, name)
            return JSONResponse({"words": words, "code": error.code}, status_code=422)
    hub.take(Opened(hub.now, name, series, words))
    return JSONResponse({"words": words})


async def _previous(request: Request) -> Response:
    """Take a calibration file to compare with."""
    from flinders.core.calibration_file import loads
    from flinders.fitting.result import Fit

    hub: Hub = request.app.state.hub
    async with _dropped(request, CALIBRATION_BYTES, "that is no calibration file") as (path, name):
        previous = Fit.from_document(loads(path.read_bytes(), source=name), name=name)
    hub.take(GotPrevious(hub.now, previous))
    return JSONResponse({"words": f"compared with {name}"})


@contextlib.asynccontextmanager
async def _dropped(request: Request, most: int, advice: str) -> AsyncIterator[tuple[Path, str]]:
    """A file that was dropped on the page, copied to one of our own, which goes afterwards; and the name it had."""
    name = shown_name(request.query_params.get("name", ""))
    uploads: Uploads = request.app.state.uploads
    with tempfile.TemporaryDirectory(prefix="flinders-") as folder, uploads.counting() as count:
        path = Path(folder) / f"dropped-{secrets.token_hex(4)}"
        try:
            with path.open("wb") as file:
                async for chunk in _sent(request, name):
                    if count(len(chunk)) > most:
                        raise HTTPException(413, f"{name} is larger than {most >> 20} MB: {advice}")
                    if uploads.size > UPLOAD_BYTES:
                        raise HTTPException(503, f"other files are on their way: drop {name} again in a moment")
                    file.write(chunk)
        except OSError as error:
            raise OutputError(f"a file for what was dropped cannot be written: {reason(error)}") from None
        yield path, name


async def _sent(request: Request, name: str) -> AsyncIterator[bytes]:
    """The body of a request, a piece at a time; one that stalls is dropped."""
    chunks = request.stream()
    while True:
        try:
            async with asyncio.timeout(STALLED_S):
                chunk = await anext(chunks)
        except StopAsyncIteration:
            return
        except TimeoutError:
            words = f"{name} stopped coming for {STALLED_S:g} s: drop it again"
            raise HTTPException(408, words, {"Connection": "close"}) from None
        yield chunk


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
        raise HTTPException(409, "the session was started again meanwhile: look at the new calibration, and send that")
    packet = MotionCalPacket.of(finished.fit.calibration)
    confirmed = await hub.on_feed(lambda: motioncal.send(board, packet, boot=0.0))
    return JSONResponse({"words": f"{board.name}: {confirmed}"})


def _refuse_a_log(session: LiveSession) -> None:
    """See that what is shown is the calibration of the board, and not of the sensor that a log is of."""
    if session.opened is not None:
        raise NotSent(
            f"{session.opened_name} is shown, and its calibration is not this board's: go back to the sensor first"
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
            page.notices.append(Notice("error", error.message))
        page.wake.set()


async def _tell(socket: WebSocket, hub: Hub, page: Page) -> None:
    """Send a page what is new: notices, fit, state and points, the newest of each."""
    hello = hub.hello()
    page.view, page.state_revision = hello.view, hello.state.revision
    await socket.send_text(encode(hello))
    while True:
        while page.notices:
            await socket.send_text(encode(page.notices.popleft()))
        if hub.session.view is not page.view:
            page.view = hub.session.view
            await socket.send_text(encode(FitMessage(hub.session.revision, page.view)))
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
