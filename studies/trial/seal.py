"""Sealing the answers: encrypted, authenticated, with the key kept elsewhere and a hash that commits to them."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from cryptography.fernet import Fernet, InvalidToken


class SealError(Exception):
    """The seal does not open with this key, or what it holds is not what was committed to."""


def seal(answers: Any, path: Path) -> tuple[str, str]:
    """Write `answers` encrypted; the key and the SHA-256 of what is inside."""
    text = json.dumps(answers, indent=1, sort_keys=True).encode()
    key = Fernet.generate_key()
    path.write_bytes(Fernet(key).encrypt(text))
    return key.decode(), hashlib.sha256(text).hexdigest()


def unseal(path: Path, key: str, digest: str) -> Any:
    """What `seal` wrote.

    Raises:
        SealError: the key is another one, or the file or the committed hash was changed.
    """
    try:
        text = Fernet(key.strip().encode()).decrypt(path.read_bytes())
    except (InvalidToken, ValueError) as error:
        raise SealError(f"{path}: this key does not open it, or it was changed") from error
    if hashlib.sha256(text).hexdigest() != digest:
        raise SealError(f"{path}: the answers are not those that the draw committed to")
    return json.loads(text)
