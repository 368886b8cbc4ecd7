"""From a file to a recording: one file a format; `table` is what they share, `mapping` makes channels."""

from optid.core.readers.mapping import Mapped, read_recording
from optid.core.readers.table import Table, read_table

__all__ = ["Mapped", "Table", "read_recording", "read_table"]
