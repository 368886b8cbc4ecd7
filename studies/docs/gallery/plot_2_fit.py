"""
A fit that draws itself
=======================

The parameters of the sample bench are fitted to the first 2 s of its recording, and judged on 2 s of another.
"""

import matplotlib.pyplot as plt

import optid

rig, train, holdout = optid.datasets.load("bench")
fit = optid.fit(rig, train.slice(0.0, 2.0), holdout=holdout.slice(0.0, 2.0))
print(fit.summary())

# %%
# The result draws itself, on axes of yours if you like.

figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
fit.plot(axes)
plt.show()
