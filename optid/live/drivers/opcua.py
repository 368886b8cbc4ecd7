"""An OPC UA server, through asyncua: `pip install "optid[opcua]"`.

    [live.opcua]
    url = "opc.tcp://192.168.0.10:4840"
    command = "ns=2;s=Valve.Command"
    position = "ns=2;s=Axis.Position"
    heartbeat = "ns=2;s=Loop.Alive"      # optional: counts up, so that the controller there can see a lost link

Values of the nodes are in the units of the columns. One request reads all nodes, one writes the command.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from optid.errors import RigError
from optid.live.driver import Order, needed
from optid.rigs.fields import known_keys, text

TIMEOUT = 1.0  # s for any response; the session's own watchdog is shorter and acts first
HEARTBEAT = "heartbeat"


class LinkLost(ConnectionError):
    """The server does not respond."""


class Server:
    """A session with the server; every call waits for its response.

    Attributes:
        resolution: 1 if the command's node holds whole numbers, which round it, else 0.
    """

    def __init__(self, sync: Any, ua: Any, url: str, nodes: dict[str, str], measured: Sequence[str]) -> None:
        self._ua, self._beats = ua, 0
        self._client = sync.Client(url, timeout=TIMEOUT)
        try:
            self._client.connect()
            found = {role: self._client.get_node(name) for role, name in nodes.items()}
            self._types = {
                role: node.read_data_type_as_variant_type()
                for role, node in found.items()
                if role not in measured
            }
            self._measured = [found.pop(role) for role in measured]
        except Exception:
            self._hang_up()
            raise
        self._heartbeat = found.pop(HEARTBEAT, None)
        ((self._role, self._command),) = found.items()
        kind = self._types[self._role]
        self._single = kind == ua.VariantType.Float
        self.resolution = 1.0 if self._whole(kind) else 0.0

    def read(self, time: float) -> Sequence[float]:
        """Read all nodes at once; one with a bad status or without a number is NaN."""
        return [_number(one) for one in self._answer(self._client.read_attributes, self._measured)]

    def write(self, command: float, time: float) -> float:
        """Write the command, and the heartbeat where there is one."""
        typed = self._typed(self._role, command)
        nodes, values = [self._command], [typed]
        if self._heartbeat is not None:
            self._beats += 1
            nodes.append(self._heartbeat)
            values.append(self._typed(HEARTBEAT, self._beats % 2**15))
        self._answer(self._client.write_values, nodes, values)
        return float(np.float32(command)) if self._single else float(typed.Value.Value)

    def close(self) -> None:
        """End the session with the server."""
        self._hang_up()

    def _typed(self, role: str, value: float) -> Any:
        kind = self._types[role]
        number = round(value) if self._whole(kind) else float(value)
        return self._ua.DataValue(self._ua.Variant(number, kind))

    def _whole(self, kind: Any) -> bool:
        return kind not in (self._ua.VariantType.Double, self._ua.VariantType.Float)

    def _answer(self, call: Any, *arguments: Any) -> Any:
        try:
            return call(*arguments)
        except Exception as error:
            raise LinkLost(f"{type(error).__name__}: {error}".rstrip(": ")) from error

    def _hang_up(self) -> None:
        with suppress(Exception):  # a dead link cannot be closed properly; its thread stops all the same
            self._client.disconnect()


def _number(read: Any) -> float:
    value = read.Value.Value if read.Value is not None else None
    return float(value) if read.StatusCode.is_good() and isinstance(value, int | float) else math.nan


def server(order: Order) -> Server:
    """The server and nodes of `[live.opcua]`.

    Raises:
        InputError: the package is not installed.
        RigError: an entry is missing, or the server or a node cannot be reached.
    """
    measured = [c.role for c in order.wiring.measured]
    roles, where, field = [order.wiring.command.role, *measured], order.rig.path, "live.opcua"
    known_keys(order.options, ["url", HEARTBEAT, *roles], where, f"{field}.")
    names = roles + ([HEARTBEAT] if HEARTBEAT in order.options else [])
    url = text(order.options, "url", where, f"{field}.url", 'url = "opc.tcp://host:4840"')
    nodes = {
        role: text(order.options, role, where, f"{field}.{role}", f'{role} = "ns=2;s=..."') for role in names
    }
    sync, ua = needed("asyncua.sync", "opcua"), needed("asyncua.ua", "opcua")
    try:
        return Server(sync, ua, url, nodes, measured)
    except Exception as error:
        message = f"{url} cannot be used ({type(error).__name__}: {error})"
        raise RigError(message, where=where, field=field) from error
