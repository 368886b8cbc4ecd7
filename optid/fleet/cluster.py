"""A Dask cluster as an executor: its scheduler and workers are started by Dask's own launchers."""

from __future__ import annotations

import ipaddress
import logging
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from optid.core.version import version
from optid.errors import InputError, JobError

PATIENCE = 30.0  # s in which a scheduler must answer


@dataclass(frozen=True)
class Certificates:
    """Files for TLS, in PEM: who may sign, and what this client shows."""

    authority: str
    certificate: str
    key: str


class ClusterExecutor(Executor):
    """Dask's own executor, which also knows when its scheduler is lost."""

    def __init__(self, client: Any) -> None:
        self._client, self._inner = client, client.get_executor(pure=False)

    @property
    def is_lost(self) -> bool:
        """The scheduler no longer answers."""
        return str(self._client.status) != "running"

    def submit(self, function: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have a worker call a function."""
        if self.is_lost:
            raise RuntimeError("the connection to the scheduler is lost")
        future: Future[Any] = self._inner.submit(function, *args, **kwargs)
        return future


@contextmanager
def connected(address: str, certificates: Certificates | None = None) -> Iterator[ClusterExecutor]:
    """A running scheduler as an executor.

    Parameters
    ----------
    address : str
        "tcp://head:8786", or "tls://head:8786" with certificates.
    certificates : Certificates | None
        for TLS.

    Raises
    ------
    InputError
        nothing answers there, or `distributed` is not installed.
    JobError
        its workers run another version of optid.
    """
    try:
        from distributed import Client, Security
    except ImportError:
        raise InputError(
            "needs the package distributed", where="--on", hint='pip install "optid[fleet]"'
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it means for the rows is said here
    security = None
    if certificates is not None:
        security = Security(
            tls_ca_file=certificates.authority,
            tls_client_cert=certificates.certificate,
            tls_client_key=certificates.key,
            require_encryption=True,
        )
    try:
        client = Client(address, security=security, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"no scheduler responds ({error})",
            where="--on",
            expected="the address that dask scheduler prints",
        ) from None
    try:
        _refuse_other_versions(client)
        yield ClusterExecutor(client)
    finally:
        client.close(timeout=2)


def is_open(address: str) -> bool:
    """Whether anyone who reaches the address can run programs on its workers: not encrypted, and not local."""
    parts = urlsplit(address)
    host = parts.hostname or ""
    if parts.scheme == "tls" or host == "localhost":
        return False
    try:
        return not ipaddress.ip_address(host).is_loopback
    except ValueError:
        return True


def _refuse_other_versions(client: Any) -> None:
    own = version()
    for worker, other in client.run(version).items():
        if other != own:
            raise JobError(f"{worker} runs optid {other}, this is {own}: install the same version on all")
