"""From a file to a recording: one file per format; `table` is what they share, `mapping` makes channels."""

from optid.core.readers.formats import read_table
from optid.core.readers.mapping import Mapped, read_recording
from optid.core.readers.table import Table

__all__ = ["Mapped", "Table", "read_recording", "read_table"]
