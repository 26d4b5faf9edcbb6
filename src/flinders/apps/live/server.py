"""HTTP and WebSocket server of a hub: routes, and messages to each page."""

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

import msgspec
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocketDisconnect

from flinders.apps.live.access import Gate, Guard, Tokens, answer, shown_name
from flinders.apps.live.hub import UPLOAD_BYTES, Hub, Page
from flinders.apps.live.messages import (
    MAX_MESSAGE_BYTES,
    Edits,
    Kept,
    Linked,
    Notice,
    Previous,
    encode,
    parse,
    readings_frame,
)
from flinders.core.files import reason_and_remedy
from flinders.core.units import MICROTESLA
from flinders.errors import (
    FitError,
    FlindersError,
    LinkError,
    NotSent,
    OutputError,
    UsageError,
    bug_message,
)
from flinders.fitting.result import document_of
from flinders.likelihood.site_field import Site
from flinders.report.modules import script
from flinders.report.view import View

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator, Sequence

    from starlette.requests import Request
    from starlette.routing import BaseRoute
    from starlette.types import ASGIApp
    from starlette.websockets import WebSocket

    from flinders.apps.live.finished import FinishedCalibration
    from flinders.apps.live.session_file import Log
    from flinders.core.calibration_file import ProvenanceRecord

STATIC: Final = Path(__file__).parent / "static"
LIBRARY: Final = "flinders", "static"  # Modules shared with reports
LANGUAGES: Final = STATIC.parents[2] / "languages"
SCRIPTS: Final[dict[str, tuple[str, tuple[str, ...]]]] = {
    "page.js": ("apps/live/static/live.js", ()),
    "station.js": ("apps/live/static/station/station.js", ()),
    "worker.js": ("apps/live/static/standalone/worker.js", ()),
    "views/scene.js": ("static/views/scene.js", ("Scene",)),
}
"""Scripts that are joined from a module and its imports: name of the module, and its exports."""
COMPRESSION: Final = (Middleware(GZipMiddleware, compresslevel=6),)
"""Compression of the page, from 600 to 208 kB: over 4 Mbit/s the page loads in 1.6 s instead of 2.1 s."""
MAX_SILENCE_S: Final = 2.0  # Longest time between messages: a page treats a silent connection as lost
JSON: Final = "application/json"
MAX_PAGES: Final = 20
MAX_NOISE_LETTERS: Final = 20  # Longest number that a page sends
CALIBRATION_BYTES: Final = 1 << 20  # Largest calibration file, sent to each page; 100 times the usual size
MAX_STALL_S: Final = 10.0  # Longest time without data in an upload


@dataclass(slots=True)
class Uploads:
    """Uploads in progress: their total size is limited to that of one file, and files are read one by one."""

    size: int = 0
    reading: asyncio.Lock = field(default_factory=asyncio.Lock)

    @contextlib.contextmanager
    def count_bytes(self) -> Iterator[Callable[[int], int]]:
        """Yield a function that adds a number of bytes to an upload, and returns the upload's size so far.

        The bytes count to the `size` of all uploads in progress until the end of the block.
        """
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


def application(
    hub: Hub,
    gate: Gate,
    tokens: Tokens | None = None,
    say: Callable[[str], None] = print,
    tables: Callable[[], bytes] = bytes,
    more: Sequence[BaseRoute] = (),
) -> ASGIApp:
    """Return the application of a hub, with its routes and access control.

    `tables` returns the data of the page as JSON. `more` are routes that take precedence, such as those of another
    page. The other parameters are those of `Guard`.
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
        *more,
        Route("/", _index, middleware=COMPRESSION),
        WebSocketRoute("/socket", _socket),
        Route("/page.json", _data, middleware=COMPRESSION),
        Route("/flinders.wasm", _engine, middleware=COMPRESSION),
        Route("/plan", _plan),
        Route("/finish", _finish, methods=["POST"]),
        Route("/calibration.json", _calibration),
        Route("/session.csv", _recording),
        Route("/report.html", _report),
        Route("/export/{target}", _export),
        Route("/open", _open, methods=["POST"]),
        Route("/previous", _previous, methods=["POST"]),
        Route("/send", _send, methods=["POST"]),
        *(Route(f"/static/{entry}", _script, middleware=COMPRESSION) for entry in SCRIPTS),
        Mount("/languages", StaticFiles(directory=LANGUAGES), middleware=COMPRESSION),
        Mount("/static", StaticFiles(directory=STATIC, packages=[LIBRARY], check_dir=False), middleware=COMPRESSION),
    ]
    handlers = dict.fromkeys((FlindersError, HTTPException, Exception), _on_error)
    app = Starlette(routes=routes, lifespan=lifespan, exception_handlers=handlers)
    app.state.hub, app.state.uploads, app.state.tables = hub, Uploads(), tables
    return Guard(app, gate, tokens, say)


async def _on_error(_: Request, error: Exception) -> Response:
    """Convert an error to an answer whose status says: missing, unreadable, or not possible now."""
    if isinstance(error, HTTPException):
        return answer(error.detail, error.status_code, error.headers)
    if not isinstance(error, FlindersError):
        return answer(bug_message(error), 500)
    status = {2: 400, 5: 422}.get(error.exit_code, 409)
    return JSONResponse({"words": error.message, "code": error.code}, status_code=status)


async def _index(_: Request) -> Response:
    page = STATIC / "index.html"
    if not page.exists():
        raise HTTPException(500, "the page is missing from this installation: install Flinders again")
    return FileResponse(page, media_type="text/html; charset=utf-8")


def _script(request: Request) -> Response:
    """Answer with a script of the page; 404 if the installation lacks the 3-D view, which the page can do without."""
    entry = request.url.path.removeprefix("/static/")
    try:
        module, exported = SCRIPTS[entry]
        return Response(script(module, exported=exported), media_type="text/javascript; charset=utf-8")
    except FileNotFoundError:
        raise HTTPException(404, f"{entry} is missing from this installation") from None


async def _data(request: Request) -> Response:
    """Answer with the page's data: sentences, tables, and layouts of structs."""
    return Response(await asyncio.to_thread(request.app.state.tables), media_type=JSON)


async def _engine(_: Request) -> Response:
    """Answer with the engine for browsers."""
    from flinders.native import build

    try:
        module = await asyncio.to_thread(build.library, target=build.WEB_PLATFORM)
    except build.NoCompiler as error:
        raise HTTPException(501, str(error)) from error
    return FileResponse(module, media_type="application/wasm")


async def _plan(request: Request) -> Response:
    """Answer with the plan of a recording for a body and a noise in µT."""
    from flinders.apps.live.planned import planned_recording

    asked = request.query_params
    noise = f"{asked.get('noise', '')[:MAX_NOISE_LETTERS]} uT"
    planned = await asyncio.to_thread(planned_recording, asked.get("body", ""), noise)
    return Response(msgspec.json.encode(planned), media_type=JSON)


async def _finish(request: Request) -> Response:
    """Make the calibration of the readings so far with the page's edits, and answer with its view."""
    from flinders.apps.live.finished import CalibrationRequest

    hub: Hub = request.app.state.hub
    edits = parse(await _body(request))
    if not isinstance(edits, Edits):
        raise UsageError("the request lacks the settings of a page: reload the page")
    asked = request.query_params
    made = await hub.finish(CalibrationRequest(edits, asked.get("log"), asked.get("previous", "")))
    return Response(
        msgspec.json.encode(_FinishedAnswer(made.number, made.name, made.view, made.refusal)), media_type=JSON
    )


class _FinishedAnswer(msgspec.Struct, frozen=True):
    """Answer to a page about a finished calibration."""

    number: str
    name: str
    view: View | None
    refusal: str


async def _body(request: Request) -> bytes:
    """Read a short body of a request."""
    body = b""
    async for chunk in _body_pieces(request, "the message"):
        body += chunk
        if len(body) > MAX_MESSAGE_BYTES:
            raise HTTPException(413, f"a message of more than {MAX_MESSAGE_BYTES:,} bytes")
    return body


def _made(request: Request) -> FinishedCalibration:
    """Return the finished calibration whose number a request states."""
    hub: Hub = request.app.state.hub
    made = hub.finished.get(request.query_params.get("of", ""))
    if made is None:
        raise HTTPException(409, "that calibration is no longer in memory: press Finish again")
    return made


async def _calibration(request: Request) -> Response:
    """Answer with the calibration file."""
    from flinders.core.calibration_file import dumps

    made = _made(request)
    content = dumps(document_of(made.fit, _provenance(made)))
    return _download(content.encode(), "calibration.json", JSON)


async def _recording(request: Request) -> Response:
    """Answer with the file of the session so far."""
    from flinders.apps.live.transfers import snapshot

    hub: Hub = request.app.state.hub
    if not hub.supply.path.exists():
        raise HTTPException(404, "nothing has been recorded yet")
    return await asyncio.to_thread(snapshot, hub.supply.path)


async def _report(request: Request) -> Response:
    """Answer with the report as one file."""
    from flinders.report.html import page

    finished = _made(request)
    if isinstance(finished.outcome, FlindersError) and not isinstance(finished.outcome, FitError):
        raise finished.outcome
    text = await asyncio.to_thread(page, finished.outcome, finished.recording, provenance=_provenance(finished))
    return _download(text.encode(), "report.html", "text/html; charset=utf-8")


def _provenance(finished: FinishedCalibration) -> ProvenanceRecord:
    """Return release, time and source file of a calibration."""
    from flinders.core.calibration_file import ProvenanceRecord

    return ProvenanceRecord(
        flinders=version("flinders"), date=datetime.now(UTC).replace(microsecond=0), files=finished.files
    )


async def _export(request: Request) -> Response:
    """Answer with the calibration for a target: text with notes, or the file."""
    from flinders.fitting.export import options_of_claim
    from flinders.targets import find

    try:
        row = find(request.path_params["target"])
    except UsageError as error:
        raise HTTPException(404, error.message) from None
    is_preview = "application/json" in request.headers.get("accept", "")
    finished = _made(request)
    fit, about = finished.fit, finished.about
    try:
        export = await asyncio.to_thread(row.render, fit.calibration, about=about, asked=options_of_claim(fit))
    except FlindersError as error:
        if is_preview:  # a preview for a target that cannot hold the calibration is not an error of the page
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
    """Read a log that was dropped on a page, and answer with its facts and readings."""
    from flinders.apps.live.transfers import load_upload

    hub: Hub = request.app.state.hub
    async with _save_upload(request, UPLOAD_BYTES, "calibrate it with flinders calibrate") as (path, name):
        try:
            async with request.app.state.uploads.reading:
                log, words = await asyncio.to_thread(load_upload, path, name)
        except FlindersError as error:
            words = error.message.replace(str(path), name).replace(path.name, name)
            return JSONResponse({"words": words, "code": error.code}, status_code=422)
    about = _LogFacts(hub.keep(name, log), name, words, log.is_timed, str(log.axes), log.site)
    return Response(await asyncio.to_thread(_pack_log, about, log), media_type="application/octet-stream")


class _LogFacts(msgspec.Struct, frozen=True):
    """Facts about a log, for a page."""

    number: str
    name: str
    words: str
    is_timed: bool
    axes: str
    site: Site | None


def _pack_log(about: _LogFacts, log: Log) -> bytes:
    """Pack a log: eight bytes with the length of the JSON, the JSON with its facts, and a frame of readings."""
    head = msgspec.json.encode(about)
    head += b" " * (-len(head) % 8)
    buffer = log.buffer
    frame = readings_frame(
        generation=0,
        first=0,
        stride=buffer.stride,
        total=buffer.total,
        is_last=True,
        rows=buffer.rows(0, len(buffer)),
        latest=buffer.latest,
        is_microtesla=log.unit.inside == MICROTESLA,
        is_vehicle=log.advice_frame == "vehicle",
    )
    return len(head).to_bytes(8, "little") + head + frame


async def _previous(request: Request) -> Response:
    """Store a calibration file to compare with."""
    hub: Hub = request.app.state.hub
    async with _save_upload(request, CALIBRATION_BYTES, "this is not a calibration file") as (path, name):
        hub.compare_with(Previous(name, path.read_bytes().decode(errors="replace")))
    return JSONResponse({"words": f"compared with {name}"})


@contextlib.asynccontextmanager
async def _save_upload(request: Request, most: int, advice: str) -> AsyncIterator[tuple[Path, str]]:
    """Yield a temporary copy of a file that was dropped on the page, and its name; the copy is deleted afterwards."""
    name = shown_name(request.query_params.get("name", ""))
    uploads: Uploads = request.app.state.uploads
    with tempfile.TemporaryDirectory(prefix="flinders-") as folder, uploads.count_bytes() as count:
        path = Path(folder) / f"dropped-{secrets.token_hex(4)}"
        try:
            with path.open("wb") as file:
                async for chunk in _body_pieces(request, name):
                    if count(len(chunk)) > most:
                        raise HTTPException(413, f"{name} is larger than {most >> 20} MB: {advice}")
                    if uploads.size > UPLOAD_BYTES:
                        raise HTTPException(503, f"other uploads are in progress: drop {name} again in a moment")
                    file.write(chunk)
        except OSError as error:
            raise OutputError(f"a temporary copy of the file cannot be written: {reason_and_remedy(error)}") from None
        yield path, name


async def _body_pieces(request: Request, name: str) -> AsyncIterator[bytes]:
    """Yield the body of a request in pieces; refuse a body that stalls."""
    chunks = request.stream()
    while True:
        try:
            async with asyncio.timeout(MAX_STALL_S):
                chunk = await anext(chunks)
        except StopAsyncIteration:
            return
        except TimeoutError:
            words = f"no data of {name} arrived for {MAX_STALL_S:g} s: send it again"
            raise HTTPException(408, words, {"Connection": "close"}) from None
        yield chunk


async def _send(request: Request) -> Response:
    """Send the calibration to the board of the readings."""
    from flinders.links import motioncal
    from flinders.targets.motioncal import MotionCalPacket

    hub: Hub = request.app.state.hub
    board = hub.supply.board
    if board is None:
        raise LinkError(
            "this source cannot receive a calibration: save the calibration and use flinders send, or paste the export"
        )
    finished = _made(request)
    if not finished.is_of_sensor:
        raise NotSent(f"this calibration belongs to {finished.name}, not to the board: go back to the sensor first")
    packet = MotionCalPacket.of(finished.fit.calibration)
    confirmed = await hub.on_feed(lambda: motioncal.send(board, packet, boot=0.0))
    return JSONResponse({"words": f"{board.name}: {confirmed}"})


async def _socket(socket: WebSocket) -> None:
    """Serve one page with two tasks, one to receive and one to send."""
    hub: Hub = socket.app.state.hub
    await socket.accept()
    if len(hub.pages) >= MAX_PAGES:
        await socket.close(1013, f"{MAX_PAGES} pages are open: close one")
        return
    page = Page()
    hub.add_page(page)
    telling = asyncio.get_running_loop().create_task(_send_messages(socket, hub, page))
    try:
        await _receive_messages(socket, hub, page)
    except WebSocketDisconnect:
        pass
    finally:
        hub.pages.discard(page)
        telling.cancel()
        with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
            await telling


async def _receive_messages(socket: WebSocket, hub: Hub, page: Page) -> None:
    """Process the messages of a page; invalid ones have no effect."""
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
        page.heard += 1
        try:
            _process_message(hub, message.get("text"))
        except FlindersError as error:
            page.queue_message(Notice("error", error.message))
            page.queue_message(Kept(hub.edits, page.heard))


def _process_message(hub: Hub, text: str | None) -> None:
    """Apply a message of a page."""
    if text is None:
        raise UsageError("the message is not text")
    said = parse(text)
    if isinstance(said, Edits):
        hub.edit(said)
    else:
        hub.compare_with(said)


async def _send_messages(socket: WebSocket, hub: Hub, page: Page) -> None:
    """Send new messages, in order, and readings to a page."""
    await socket.send_text(encode(hub.welcome()))
    while True:
        page.wake.clear()
        while (message := page.next_message()) is not None:
            await socket.send_text(encode(message))
        if (frame := hub.frame(page)) is not None:
            await socket.send_bytes(frame)
            continue
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(MAX_SILENCE_S):
                await page.wake.wait()
                continue
        await socket.send_text(encode(Linked(hub.source)))
