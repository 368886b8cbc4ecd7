"""`python -m optid.cli`."""

from optid.cli import main

main()
