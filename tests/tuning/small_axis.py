"""A servo axis in small: an integrator behind a resonance, sampled."""

import numpy as np
from scipy.signal import cont2discrete

from optid.armax.model import Armax

T = 2e-3


def axis(gain=0.55, frequency=60.0, damping=0.4, delay=1, spread=None):
    """Speed gain (m/s per V), rad/s, damping ratio, delay in samples; `spread` is the coefficients' relative sd."""
    numerator = [gain * frequency**2]
    denominator = [1.0, 2 * damping * frequency, frequency**2, 0.0]
    b, a, _ = cont2discrete((numerator, denominator), T)
    b = b.ravel()[1:]
    covariance = None
    if spread:
        # Only the numerator is in doubt: the poles stay, the gain and its delay move.
        sd = np.r_[np.zeros(3), spread * np.abs(b)]
        covariance = tuple(map(tuple, np.diag(sd**2)))
    return Armax(tuple(a), (tuple(b),), (1.0,), (delay,), T, 1e-9, covariance)


def python_control(model, gains):
    """The loop gain as python-control has it, from the formulas of the controller."""
    import control

    z = control.tf([1, 0], [1], T)
    C = gains.kp + gains.kd * (z - 1) / ((gains.derivative_filter + T) * z - gains.derivative_filter)
    if gains.ki:
        C = C + gains.ki * T * z / (z - 1)
    return control.tf(*model.powers_of_z(), T) * C
