"""Who may talk to the page's server: pure functions of what a request says.

A page of another site can make a browser connect to 127.0.0.1, and a name that such a site owns can be made to lead
there. So a request has to name this server as its host, and one that changes something, or opens a socket, has to come
from a page of this server. On other addresses than the loopback a token is asked for besides, which only the terminal
shows.

>>> gate = Gate.of("127.0.0.1", 8410)
>>> gate.refusal(host="127.0.0.1:8410", origin="http://127.0.0.1:8410", needs_origin=True) is None
True
>>> print(gate.refusal(host="evil.example:8410", origin=None, needs_origin=False))
this server is not evil.example:8410: open the address that flinders live prints
>>> print(gate.refusal(host="127.0.0.1:8410", origin="http://evil.example", needs_origin=True))
http://evil.example is another site: only pages of this server may do that
"""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
from dataclasses import dataclass, field
from typing import Final, Self
from urllib.parse import urlsplit

CSP: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "font-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
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
"""On every answer."""
LONGEST_NAME: Final = 100
"""Letters of a file's name that are shown."""
TOKEN_BYTES: Final = 16


@dataclass(frozen=True, slots=True)
class Gate:
    """What is let through.

    Attributes
    ----------
    port : int
    names : frozenset of str
        By which this server may be called, besides addresses in figures where it listens on all of them.
    is_open : bool
        It listens on addresses that other machines reach.
    """

    port: int
    names: frozenset[str]
    is_open: bool

    @classmethod
    def of(cls, host: str, port: int, own_names: tuple[str, ...] = ()) -> Self:
        """The gate of a server that listens on `host`; `own_names` are what this machine is called."""
        names = {"127.0.0.1", "localhost", "::1", host.strip("[]").casefold()}
        is_open = not is_loopback(host)
        if is_open:
            names |= {name.casefold() for own in own_names if own for name in (own, f"{own}.local")}
        return cls(port, frozenset(names), is_open)

    def refusal(self, *, host: str | None, origin: str | None, needs_origin: bool) -> str | None:
        """Say why a request is refused; None where it is let through.

        Parameters
        ----------
        host, origin : str or None
            Its headers.
        needs_origin : bool
            It changes something, or opens a socket: browsers then always say where they come from.
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


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address.

    >>> is_loopback("127.0.0.1"), is_loopback("localhost"), is_loopback("0.0.0.0")
    (True, True, False)
    """
    return host.casefold() == "localhost" or (is_address(host) and ipaddress.ip_address(host.strip("[]")).is_loopback)


def is_address(name: str) -> bool:
    """Whether it is an address in figures: nobody can make such a name lead elsewhere."""
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


@dataclass(slots=True)
class Tokens:
    """One-time tokens: the first browser that shows one gets a cookie, and the next one needs a new token.

    Attributes
    ----------
    current : str
        To be printed.
    """

    current: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES))
    _cookies: set[str] = field(default_factory=set)

    def redeem(self, token: str) -> str | None:
        """Change a token for a cookie, once; None for another one."""
        if not hmac.compare_digest(token.encode(), self.current.encode()):
            return None
        self.current = secrets.token_urlsafe(TOKEN_BYTES)
        cookie = secrets.token_urlsafe(TOKEN_BYTES)
        self._cookies.add(cookie)
        return cookie

    def knows(self, cookie: str | None) -> bool:
        """Whether a cookie is one that was given."""
        given = [hmac.compare_digest((cookie or "").encode(), known.encode()) for known in self._cookies]
        return any(given)


def cookie_name(port: int) -> str:
    """Cookies are shared by all ports of a host: each server has its own."""
    return f"flinders-{port}"


def set_cookie(port: int, value: str) -> str:
    """The header that gives a cookie: not for scripts, not for other sites."""
    return f"{cookie_name(port)}={value}; HttpOnly; SameSite=Strict; Path=/"


def cookie_of(header: str | None, port: int) -> str | None:
    """Find the cookie of this server in a header.

    >>> cookie_of("theme=dark; flinders-8410=abc", 8410)
    'abc'
    """
    for part in (header or "").split(";"):
        name, _, value = part.strip().partition("=")
        if name == cookie_name(port):
            return value
    return None


def shown_name(name: str) -> str:
    r"""A file's name from a browser as it may be shown: no folder, nothing that is not printed, not too long.

    It is never opened.

    >>> shown_name("../../etc/pass\nwd.csv"), shown_name("")
    ('passwd.csv', 'a file')
    """
    last = re.split(r"[/\\]", name)[-1] if "://" not in name else name
    text = "".join(letter for letter in last if letter.isprintable()).strip()
    return text[:LONGEST_NAME] or "a file"
