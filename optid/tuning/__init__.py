"""PID gains by optimising the closed loop itself on an identified model, under the actuator's limits."""
