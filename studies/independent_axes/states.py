"""Where each state stands in the vector of either axis."""

X, P = 0, 1  # position, and momentum of what moves with it
SEEN = 2  # what the sensor's filter holds
# Hydraulic: content of the chambers, m3 at no pressure. rotary: twist of the shaft, momentum of the motor.
A, B = 3, 4
C, D = 5, 6  # hydraulic: opening of the spool and its rate. rotary: heat in the winding
E, F = 7, 8  # hydraulic: pressures that the hoses' walls have followed
SMOOTH = 9  # so many obey differential equations; the rest remembers, and changes once a step

GEAR = 9  # position of the sensor's gear
WAY = 10  # direction of motion: +1, -1, or 0 while dry friction holds
REST = 11  # s for which it has been at rest
GOAL = 12  # what the drive or the valve is told
STOOD = 13  # command at which a sticky spool stands
PLAY = 14  # 14..17: plays of the hysteresis
COUNT = 18
SHARES = (0.4, 0.8, 1.2, 1.6)  # of the plays, over their mean
