"""
A fit, and what its uncertainty means for a prediction
======================================================

Two parameters of the sample bench are fitted to 1.5 s. The band is the 95 % interval of the prediction that the
parameters' uncertainty gives.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

import optid

rig, train, holdout = optid.datasets.load("bench")
few = [free for free in rig.freed if free.name in ("viscous_friction", "coulomb_friction")]
rig = replace(rig, freed=tuple(few))
fit = optid.fit(rig, train.slice(0.0, 1.5), holdout=holdout.slice(0.0, 1.5))
print(fit.summary())

# %%
# The result draws itself, on axes of yours if you like.

figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
fit.plot(axes)
plt.show()
