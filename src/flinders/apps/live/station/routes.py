"""Requests of a station's page, in addition to those of every live page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import msgspec
from msgspec import Struct
from starlette.responses import FileResponse, Response
from starlette.routing import Route

from flinders.apps.live.server import COMPRESSION, JSON, STATIC
from flinders.apps.live.station.plan import Motion
from flinders.core.calibration_file import readable_message
from flinders.errors import UsageError

if TYPE_CHECKING:
    from starlette.requests import Request

    from flinders.apps.live.station.bench import Station
    from flinders.apps.live.station.plan import Plan

MAX_BODY: Final = 4096


class Asked(Struct, frozen=True, forbid_unknown_fields=True):
    """Request of the page: an action of the operator."""

    do: Literal["start", "finish", "abort", "next", "operator"]
    serial: str = ""
    again: bool = False  # confirms a repeated test
    name: str = ""  # of the operator


class PageFacts(Struct, frozen=True):
    """Constant facts for the page."""

    name: str  # of the station
    motion: Motion
    takes_limited: bool  # a limited calibration passes, too
    target_deg: float


def routes_of(station: Station) -> list[Route]:
    """Routes of the station: page, state, and actions of the operator."""

    async def page(_: Request) -> Response:
        return FileResponse(STATIC / "station" / "station.html", media_type="text/html; charset=utf-8")

    async def state(_: Request) -> Response:
        return Response(msgspec.json.encode(station.state), media_type=JSON)

    async def facts(_: Request) -> Response:
        return Response(msgspec.json.encode(_facts(station.name, station.plan)), media_type=JSON)

    async def act(request: Request) -> Response:
        await _perform(station, await _action_of(request))
        return await state(request)

    return [
        Route("/", page, middleware=COMPRESSION),
        Route("/station.json", state),
        Route("/station-facts.json", facts),
        Route("/station", act, methods=["POST"]),
    ]


def _facts(name: str, plan: Plan) -> PageFacts:
    return PageFacts(name, plan.motion, plan.limits.verdict == "limited", plan.limits.heading_error_deg)


async def _action_of(request: Request) -> Asked:
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > MAX_BODY:
            raise UsageError(f"a message of more than {MAX_BODY:,} bytes: scan the label again")
    try:
        return msgspec.json.decode(body, type=Asked)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise UsageError(f"not a message of this page: {readable_message(error)}") from None


async def _perform(station: Station, asked: Asked) -> None:
    match asked.do:
        case "start":
            await station.start(asked.serial, again=asked.again)
        case "finish":
            await station.finish()
        case "abort":
            await station.abort()
        case "next":
            station.next()
        case "operator":
            station.name_operator(asked.name)
