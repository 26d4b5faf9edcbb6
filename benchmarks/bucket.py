"""A local object store with latency: one bucket, with what the protocols of S3 and Google Cloud Storage share.

It supports lists, reads of whole objects and of ranges, and writes in one request; there is no authentication.

>>> from urllib.request import urlopen
>>> with Bucket({"a/1.csv": b"x,y,z"}) as bucket:
...     with urlopen(f"{bucket.address}/fleet/a/1.csv") as answer:
...         answer.read(), bucket.asked
(b'x,y,z', 1)
"""

from __future__ import annotations

import json
import re
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Final, Self
from urllib.parse import parse_qs, unquote, urlsplit
from xml.sax.saxutils import escape

if TYPE_CHECKING:
    from collections.abc import Mapping

PAGE: Final = 1000
"""Largest number of objects in one list, as in commercial stores."""


class Bucket:
    """A server with one bucket, which runs inside a ``with`` block.

    Parameters
    ----------
    objects : mapping of str to bytes
        Content of each object, by name.
    latency_s : float, s
        Delay of each response.
    name : str
        Name of the bucket.

    Attributes
    ----------
    objects : dict
        Content at present.
    asked, opened, most : int
        Number of requests so far, number of connections so far, and largest number of concurrent requests.
    refuses : int
        HTTP status with which writes are refused; 0 to accept them.
    """

    def __init__(
        self, objects: Mapping[str, bytes] | None = None, *, latency_s: float = 0.0, name: str = "fleet"
    ) -> None:
        self.objects, self.latency_s, self.name = dict(objects or {}), latency_s, name
        self.asked = self.opened = self.most = self.refuses = 0
        self._waiting = 0
        self._lock = threading.Lock()
        self._server = _Server(("127.0.0.1", 0), type("Handler", (_Handler,), {"bucket": self}))
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.01})

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    @property
    def address(self) -> str:
        """Address of the server."""
        return f"http://127.0.0.1:{self._server.server_port}"

    @property
    def environment(self) -> dict[str, str]:
        """Environment variables that make ``s3://`` and ``gs://`` addresses lead to this server."""
        nobody = {"disable_oauth": True, "client_email": "", "private_key": "", "private_key_id": ""}
        return {
            "AWS_ENDPOINT": self.address,
            "AWS_ALLOW_HTTP": "true",
            "AWS_REGION": "us-east-1",
            "AWS_ACCESS_KEY_ID": "a",
            "AWS_SECRET_ACCESS_KEY": "b",
            "GOOGLE_SERVICE_ACCOUNT_KEY": json.dumps({"gcs_base_url": self.address, **nobody}),
            "GOOGLE_ALLOW_HTTP": "true",
        }

    def begun(self) -> None:
        """Count a request, and wait for the latency."""
        with self._lock:
            self.asked += 1
            self._waiting += 1
            self.most = max(self.most, self._waiting)
        time.sleep(self.latency_s)
        with self._lock:
            self._waiting -= 1

    def connected(self) -> None:
        """Count a connection."""
        with self._lock:
            self.opened += 1


class _Server(ThreadingHTTPServer):
    """Server for many concurrent connections."""

    request_queue_size = 1024


class _Handler(BaseHTTPRequestHandler):
    """Request handler of a bucket; `http.server` prescribes the names of its methods."""

    bucket: Bucket
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def setup(self) -> None:
        super().setup()
        self.bucket.connected()

    def log_message(self, *_: object) -> None:
        """Log nothing."""

    @property
    def _key(self) -> str:
        return unquote(urlsplit(self.path).path).removeprefix(f"/{self.bucket.name}").lstrip("/")

    def do_HEAD(self) -> None:
        """Answer with the size of an object."""
        self.do_GET()

    def do_GET(self) -> None:
        """List, or send an object or a range of it."""
        self.bucket.begun()
        query = parse_qs(urlsplit(self.path).query)
        if not self._key:
            self._send(200, _listing(self.bucket, query), kind="application/xml")
            return
        content = self.bucket.objects.get(self._key)
        if content is None:
            self._send(404, b"<Error><Code>NoSuchKey</Code></Error>", kind="application/xml")
            return
        wanted = re.fullmatch(r"bytes=(\d*)-(\d*)", self.headers.get("Range", ""))
        if wanted is None:
            self._send(200, content)
            return
        first = int(wanted[1]) if wanted[1] else len(content) - int(wanted[2])
        last = min(int(wanted[2]), len(content) - 1) if wanted[1] and wanted[2] else len(content) - 1
        self._send(206, content[first : last + 1], Content_Range=f"bytes {first}-{last}/{len(content)}")

    def do_PUT(self) -> None:
        """Store an object."""
        self.bucket.begun()
        content = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        if self.bucket.refuses:
            self._send(self.bucket.refuses, b"<Error><Code>AccessDenied</Code></Error>", kind="application/xml")
            return
        self.bucket.objects[self._key] = content
        self._send(200, b"")

    def _send(self, status: int, content: bytes, *, kind: str = "application/octet-stream", **headers: str) -> None:
        self.send_response(status)
        told = {"Content-Type": kind, "ETag": f'"{hash(content):x}"', "Last-Modified": LONG_AGO, **headers}
        for name, value in told.items():
            self.send_header(name.replace("_", "-"), value)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)


LONG_AGO: Final = "Thu, 01 Jan 2026 00:00:00 GMT"


def _listing(bucket: Bucket, query: Mapping[str, list[str]]) -> bytes:
    """One page of the names with a prefix, as XML."""
    prefix, after = (query.get(name, [""])[0] for name in ("prefix", "continuation-token"))
    names = [name for name in sorted(bucket.objects) if name.startswith(prefix) and name > after]
    entries = [
        f"<Contents><Key>{escape(name)}</Key><Size>{len(bucket.objects[name])}</Size><ETag>{len(name)}</ETag>"
        "<LastModified>2026-01-01T00:00:00.000Z</LastModified></Contents>"
        for name in names[:PAGE]
    ]
    more = f"<NextContinuationToken>{escape(names[PAGE - 1])}</NextContinuationToken>" if len(names) > PAGE else ""
    return f"<ListBucketResult>{''.join(entries)}{more}</ListBucketResult>".encode()
