"""Access to the page: by the token, on this machine too, with a limit on wrong tokens."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from urllib.parse import quote, urlsplit

from aiohttp import web

LOCAL = "127.0.0.1"
NAMES = ("localhost", LOCAL, "[::1]")
PROTOCOL = "optid.live"  # of the socket
WRONG, PAUSE = 10, 60.0  # wrong tokens of an address within so many seconds, after which it waits as long
ADDRESSES = 256  # that are remembered


@dataclass(frozen=True)
class Access:
    """Where the page is served, and to whom.

    The page itself is no secret. What it shows and the orders it gives go through a socket that opens for the token
    alone. The token stands in the fragment of the address, which no browser sends or tells other pages.

    Attributes:
        host, port: to listen at; port 0 takes a free one.
        token: made at random where none is given.
    """

    host: str = LOCAL
    port: int = 0
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16), repr=False)

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
        return f"http://{host}:{port}/#token={quote(self.token, safe='')}"

    def admit(self, request: web.Request) -> None:
        """Let a request through that comes from the page itself.

        On loopback the name it was asked for by must be a loopback one: another site's page, open in the same
        browser, can send requests here but cannot forge that, nor its own origin.

        Raises:
            web.HTTPForbidden: it may not come in.
        """
        if self.local and request.host.rpartition(":")[0] not in NAMES:
            raise web.HTTPForbidden(text="this page can be opened on its own machine only\n")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            raise web.HTTPForbidden(text="this page accepts no commands from other pages\n")

    def opens(self, request: web.Request) -> bool:
        """The request has the token: as `Authorization: Bearer`, or beside the socket's protocol in hexadecimal."""
        offered = [one.strip() for one in request.headers.get("Sec-WebSocket-Protocol", "").split(",")]
        scheme, _, bearer = request.headers.get("Authorization", "").partition(" ")
        given = [bearer.strip().encode()] if scheme.lower() == "bearer" else []
        for one in offered:
            if one != PROTOCOL:
                try:
                    given.append(bytes.fromhex(one))
                except ValueError:
                    continue
        return any(hmac.compare_digest(one, self.token.encode()) for one in given)


class FailedAttempts:
    """Wrong tokens by address: after `WRONG` of them within `PAUSE` seconds, that address waits as long.

    Args:
        clock: s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._seen = clock, OrderedDict[str, list[float]]()

    def wait(self, address: str) -> float:
        """s for which an address may not try; 0 where it may."""
        times = self._recent(address)
        return times[-1] + PAUSE - self._clock() if len(times) >= WRONG else 0.0

    def wrong(self, address: str) -> bool:
        """Count a wrong token; True for the last one that the address may try for now."""
        times = [*self._recent(address), self._clock()]
        self._seen[address] = times
        self._seen.move_to_end(address)
        if len(self._seen) > ADDRESSES:
            self._seen.popitem(last=False)
        return len(times) >= WRONG

    def _recent(self, address: str) -> list[float]:
        return [one for one in self._seen.get(address, []) if self._clock() - one < PAUSE]
