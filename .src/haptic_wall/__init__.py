"""A virtual wall for a servo testbed, at a fixed rate.

``haptic_wall.controller`` decides the torque; ``haptic_wall.hw`` moves the servo. The two
folders stand at the top of the repository; links beside this file lead to them.
"""

__version__ = "0.1.0"
