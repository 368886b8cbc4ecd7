"""The blind trial's parts: what is concealed, how it is drawn, sealed, run, and scored. It imports nothing of optid.

`studies/concealed.py` is the way in.
"""
