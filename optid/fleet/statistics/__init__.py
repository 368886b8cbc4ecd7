"""Statistics of a fleet: changes with controlled false alarms, trends, rigs that differ, shared parameters.

All take one long table of `MEASURES`: a quantity of a rig on a date, one row per recording, night or fit.
"""

MEASURES = ("rig", "date", "quantity", "value", "sd")
