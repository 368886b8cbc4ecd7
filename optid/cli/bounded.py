"""The command line in the process of a fleet's job: the user's command, with limits on memory and time.

python -m optid.cli.bounded MEMORY SECONDS PARENT ARGUMENTS...
"""

from __future__ import annotations

import sys

from optid.cli import main as command
from optid.fleet.bounds import bound, die_with


def main() -> None:
    """Limit this process (bytes, s of processor time, id of the parent process) and run the command."""
    memory, seconds, parent = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
    sys.argv[1:4] = []
    die_with(parent)
    bound(memory, seconds)
    command()


if __name__ == "__main__":
    main()
