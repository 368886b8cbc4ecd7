"""What a fleet tells as a whole: changes with false ones controlled, trends, rigs unlike others, shared parameters.

All take one long table of `MEASURES`: a quantity of a rig on a date, one row a recording, night or fit.
"""

MEASURES = ("rig", "date", "quantity", "value", "sd")
