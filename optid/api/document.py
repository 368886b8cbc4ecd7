"""The head of every document: schema, version, command and inputs with their digests."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

from optid.core.recording import Recording
from optid.core.version import version as version
from optid.rigs.rigfile import Rig


def stamp(schema: str, command: str, rig: Rig, recordings: Sequence[Recording]) -> dict[str, Any]:
    """The head of a document: which version did what to which files.

    Parameters
    ----------
    schema : str
        of the document.
    command : str
        the public call.
    rig : Rig
        as read; its digest is that of its text.
    recordings : Sequence[Recording]
        all that were used; those in memory have no digest.

    Returns
    -------
    dict[str, Any]
        schema, version, command, and inputs: path or name -> SHA-256.
    """
    rig_digest = hashlib.sha256(rig.source.encode("utf-8")).hexdigest()
    return {
        "schema": schema,
        "version": version(),
        "command": command,
        "inputs": {str(rig.path): rig_digest, **{place_of(r): _digest(r) for r in recordings}},
    }


def place_of(recording: Recording) -> str:
    """Its file; the name of one in memory."""
    return str(recording.provenance.path) if recording.provenance else recording.name


def _digest(recording: Recording) -> str | None:
    return recording.provenance.sha256 if recording.provenance else None
