"""Access to the page: by the token, also on this machine, with a limit on wrong tokens."""

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
# Wrong tokens of an address within this many seconds, after which it must wait as long.
WRONG, PAUSE = 10, 60.0
ADDRESSES = 256  # addresses that are stored


@dataclass(frozen=True)
class Access:
    """Address and access rights of the page.

    The page itself is not secret. Its data and commands use a socket that opens only with the token. The token is in
    the fragment of the address, which browsers do not send to servers or other pages.

    Attributes:
        host, port: to listen at; port 0 selects a free one.
        token: made at random where none is given.
    """

    host: str = LOCAL
    port: int = 0
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16), repr=False)

    @property
    def local(self) -> bool:
        """Whether only this machine can reach it."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def listen(self) -> socket.socket:
        """Bind the address before anything else begins.

        Raises:
            OSError: it is in use, or not an address of this machine.
        """
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        return socket.create_server((self.host, self.port), family=family)

    def url(self, port: int) -> str:
        """The address that the user opens."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/#token={quote(self.token, safe='')}"

    def admit(self, request: web.Request) -> None:
        """Accept only requests that come from the page itself.

        On loopback the requested host name must be a loopback one: a page of another site in the same browser can send
        requests here but cannot forge that, nor its own origin.

        Raises:
            web.HTTPForbidden: the request is refused.
        """
        if self.local and request.host.rpartition(":")[0] not in NAMES:
            raise web.HTTPForbidden(text="this page can be opened on its own machine only\n")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            raise web.HTTPForbidden(text="this page accepts no commands from other pages\n")

    def opens(self, request: web.Request) -> bool:
        """Whether the request has the token: as `Authorization: Bearer`, or in the socket's protocol in hexadecimal."""
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
        """s for which an address is blocked; 0 if it is not."""
        times = self._recent(address)
        return times[-1] + PAUSE - self._clock() if len(times) >= WRONG else 0.0

    def wrong(self, address: str) -> bool:
        """Count a wrong token; True if it is the last one allowed for now."""
        times = [*self._recent(address), self._clock()]
        self._seen[address] = times
        self._seen.move_to_end(address)
        if len(self._seen) > ADDRESSES:
            self._seen.popitem(last=False)
        return len(times) >= WRONG

    def _recent(self, address: str) -> list[float]:
        return [one for one in self._seen.get(address, []) if self._clock() - one < PAUSE]
