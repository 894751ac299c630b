"""Numbers the rows of the arrays in which ``lanes`` simulates walls."""

from __future__ import annotations

from typing import Final

LANES: Final = 128
"""Walls simulated together: fewer pay more for each pass, more leave the first-level cache"""

# Rows of ``fixed``: what does not change.
INERTIA: Final = 0
DECAY: Final = 1
COULOMB: Final = 2
FRICTION: Final = 3
COUNTS: Final = 4
HALF: Final = 5
LIMIT: Final = 6
STEP: Final = 7
SOFTNESS: Final = 8
"""The stiffness with a minus"""
VIRTUAL: Final = 9
PERIOD: Final = 10
LATE: Final = 11
"""h1, h, s and the duration of the part of a period before the torque changes"""
HELD: Final = 15
"""The same of the rest of a period"""
FULL: Final = 19
"""Torque from which on the limit has acted"""
GONE: Final = 20
"""Periods outside a wall after which a contact is over"""
FIXED: Final = 21

# Rows of ``seen``: what an observer remembers.
BEFORE: Final = 0
"""Turning points: the last velocity other than 0. Contacts: the velocity at the last look"""
CAME: Final = 1
"""Position at the last look"""
LIMITED: Final = 2
"""Turning points: 1 if the limit has acted"""
ENTERED: Final = 2
"""Contacts: 1 if it was inside"""
OUTSIDE: Final = 3
"""Contacts: periods outside since then"""
LEAVING: Final = 4
"""Contacts: greatest speed outwards since then"""
SEEN: Final = 5

# Rows of the workspace beyond those two.
POSITION: Final = FIXED + SEEN
VELOCITY: Final = POSITION + 1
FOLLOWED: Final = POSITION + 2
MEASURED: Final = POSITION + 3
EARLIER: Final = POSITION + 4
TORQUE: Final = POSITION + 5
ACTING: Final = POSITION + 6
OVER: Final = POSITION + 7
FLAG: Final = POSITION + 8
ROWS: Final = POSITION + 9

# Traits, alike for all walls.
ONE_SIDED: Final = 0
IS_LIMITED: Final = 1
STEPPED: Final = 2
ROUNDED: Final = 3
PLAY: Final = 4
FRICTIONAL: Final = 5
LAGS: Final = 6
SAMPLES: Final = 7
"""N of the velocity difference"""
OBSERVER: Final = 8
PARTS: Final = 9
"""Substeps of two masses: before the torque changes, and after"""
STEPS: Final = 11
"""Steps of the current loops, the same; 0: no current loops"""
IN_CONTACT: Final = 13
"""The law acts in contact only, and never pulls"""
TRAITS: Final = 14

# Rows of ``loads``: two masses.
LOAD: Final = 0
SPRING: Final = 1
LOSS: Final = 2
"""Damping of the transmission"""
VISCOUS: Final = 3
ON_MOTOR: Final = 4
RESPONSES: Final = 5
"""Slide and stick, row by row, and the length of a substep: before the torque changes, and after"""
RESPONSE: Final = 21
"""Rows of one of the two"""
LOADS: Final = RESPONSES + 2 * RESPONSE
TWIST: Final = LOADS
MOTOR: Final = LOADS + 1
OUTPUT: Final = LOADS + 2
PLACE: Final = LOADS + 3
"""Position of the output"""
LOADS_ROWS: Final = LOADS + 4

# Rows of ``drives``: current loops.
BACK_EMF: Final = 0
LOST: Final = 1
STALL: Final = 2
DEAD: Final = 3
SHARES: Final = 4
"""Mean and rest of a decay over a step: before the torque changes, and after"""
DRIVES: Final = 8
VOLTAGE: Final = DRIVES
PACE: Final = DRIVES + 1
"""Velocity at the start of the last step"""
GOAL: Final = DRIVES + 2
DRIVES_ROWS: Final = DRIVES + 3

# Rows of ``kept``: the piece of a law's table in which each wall was last measured.
FROM: Final = 0
"""Measured positions of this piece begin here; -inf: of the first piece"""
TO: Final = 1
"""They end before this one; inf: of the last piece"""
START: Final = 2
"""Position of the piece's first row"""
RUN: Final = 3
"""Distance to the position of its second row"""
FIRST: Final = 4
"""Elongation of its first row"""
RISE: Final = 5
"""Difference to the elongation of its second row"""
NUMBER: Final = 6
"""Of its first row"""
KEPT: Final = 7

# Observers.
NOBODY: Final = 0
TURNINGS: Final = 1
CONTACTS: Final = 2
