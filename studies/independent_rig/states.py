"""Where each state stands in the rig's state vector."""

X, V, PA, PB = range(4)  # the piston and its chambers: all that the base equations have
TA, TB = 4, 5  # chamber temperatures
PS, PE = 6, 7  # pressures of the reservoir before the valve and of the manifold behind it
SPOOL, RATE = 8, 9  # share of full travel and its rate
X2, V2 = 10, 11  # the load behind its spring
CREEP_A, CREEP_B = 12, 13  # pressures that the tubes' walls have followed
SEEN, SEEN2 = 14, 15  # what the sensor's filter holds
SMOOTH = 16  # so many obey differential equations; the rest remembers, and changes once a step

SHARES = (0.3, 0.6, 0.95, 1.35, 1.8)  # yields of elements and plays over their mean
ELEMENT = 16  # 16..20: deflections of the contact's elements
PLAY = 21  # 21..25: plays of the valve's hysteresis
GEAR = 26  # position of the sensor's gear
STOOD = 27  # command at which a sticky spool stands
REST = 28  # s for which the piston has been at rest
WAY = 29  # direction of motion: +1, -1, or 0 while dry friction holds
GOAL = 30  # where the spool is sent, share of full travel
COUNT = 31
