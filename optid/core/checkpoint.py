"""Checkpoints of a long job, stage by stage, from which an interrupted one continues.

One JSON file with a digest of its stages: a damaged one counts as empty. Numbers are stored bit-exactly.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optid.core.document import optional_document
from optid.core.model import Model

SCHEMA = "optid.checkpoint/6"


@dataclass(frozen=True)
class Checkpoint:
    """A file of finished stages.

    Attributes:
        path: of the file; ``None`` keeps nothing.
        key: digest of the job's inputs; a file with another one counts as empty.
    """

    path: Path | None = None
    key: str = ""

    def load(self, stage: str) -> Any:
        """The stored result of a stage, or ``None``."""
        return self._stages().get(stage)

    def save(self, stage: str, content: Mapping[str, Any]) -> None:
        """Store the result of a stage; the file is replaced completely."""
        if self.path is None:
            return
        stages = {**self._stages(), stage: content}
        document = {"schema": SCHEMA, "key": self.key, "digest": _digest(stages), "stages": stages}
        part = self.path.with_name(f"{self.path.name}.{os.getpid()}.part")
        try:
            part.write_text(json.dumps(document), encoding="utf-8")
            part.replace(self.path)
        except OSError:  # a full disk prevents resuming, not the job
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)

    def clear(self) -> None:
        """Delete it: the job is done."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)

    def _stages(self) -> dict[str, Any]:
        document = None if self.path is None else optional_document(self.path)
        if document is None or (document.get("schema"), document.get("key")) != (SCHEMA, self.key):
            return {}
        stages = document.get("stages")
        return stages if isinstance(stages, dict) and document.get("digest") == _digest(stages) else {}


def equations(model: Model) -> bytes:
    """A model's functions and numbers as text, in which an edited program or option shows."""
    functions = [
        f.serialize() for f in (model.rates, model.sensors, model.start, model.halves) if f is not None
    ]
    return repr((functions, model.parameters, model.suspects, model.form_error, model.biases)).encode()


def _digest(stages: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(stages).encode()).hexdigest()
