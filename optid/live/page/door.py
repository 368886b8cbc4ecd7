"""Who may open the page: this machine alone, unless a host was named; then whoever holds the token."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from aiohttp import web

LOCAL = "127.0.0.1"
NAMES = ("localhost", LOCAL, "[::1]")
COOKIE = "optid"


@dataclass(frozen=True)
class Door:
    """Where the page is served, and to whom.

    Attributes:
        host, port: to listen at; port 0 takes a free one.
        token: asked for on every request, and made at random where none is given; not asked for on loopback.
    """

    host: str = LOCAL
    port: int = 0
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))

    @property
    def local(self) -> bool:
        """Only this machine can reach it."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def listen(self) -> socket.socket:
        """Take the address, before anything else begins.

        Raises:
            OSError: it is taken, or none of this machine's.
        """
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        return socket.create_server((self.host, self.port), family=family)

    def url(self, port: int) -> str:
        """What the user opens."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/" + ("" if self.local else f"?token={self.token}")

    def admit(self, request: web.Request) -> None:
        """Let a request through.

        On loopback the name it was asked for by must be a loopback one, and a socket must come from the page
        itself: another site's page, open in the same browser, can send requests here but cannot forge these.

        Raises:
            web.HTTPForbidden: it may not come in.
        """
        if self.local and request.host.rpartition(":")[0] not in NAMES:
            raise web.HTTPForbidden(text="this page answers to its own machine only\n")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            raise web.HTTPForbidden(text="this page takes no orders from other pages\n")
        if not self.local:
            given = request.query.get("token") or request.cookies.get(COOKIE) or ""
            if not hmac.compare_digest(given.encode(), self.token.encode()):
                raise web.HTTPForbidden(text="the token is missing or wrong\n")
