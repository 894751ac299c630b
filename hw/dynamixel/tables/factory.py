"""Factory settings in which the models of a family differ.

Source: ROBOTIS e-Manual, column "initial value" of each model's control table.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

FACTORY: Final[Mapping[str, Mapping[str, int]]] = MappingProxyType(
    {
        "XL330-M077": {
            "velocity_limit": 1620,
            "shutdown": 53,
            "velocity_i_gain": 400,
            "velocity_p_gain": 40,
            "position_i_gain": 400,
            "position_p_gain": 400,
        },
        "XL330-M288": {
            "velocity_limit": 445,
            "shutdown": 53,
            "velocity_i_gain": 1600,
            "velocity_p_gain": 180,
            "position_p_gain": 400,
        },
        "XC330-M181": {
            "velocity_limit": 545,
            "velocity_i_gain": 1400,
            "velocity_p_gain": 100,
            "position_d_gain": 500,
            "position_p_gain": 1200,
        },
        "XC330-M288": {
            "velocity_limit": 350,
            "velocity_i_gain": 1600,
            "velocity_p_gain": 50,
            "position_d_gain": 500,
            "position_p_gain": 1100,
        },
        "XC330-T181": {
            "velocity_limit": 510,
            "pwm_slope": 255,
            "velocity_i_gain": 1200,
            "velocity_p_gain": 40,
            "position_p_gain": 900,
        },
        "XC330-T288": {
            "velocity_limit": 320,
            "pwm_slope": 255,
            "velocity_i_gain": 1200,
            "velocity_p_gain": 40,
            "position_p_gain": 900,
        },
        "XM430-W210": {"velocity_limit": 330},
        "XM430-W350": {"velocity_limit": 200},
        "XH430-W210": {"velocity_limit": 210, "position_p_gain": 900},
        "XH430-W350": {"velocity_limit": 130, "position_p_gain": 900},
        "XH430-V210": {"velocity_limit": 230},
        "XH430-V350": {"velocity_limit": 135},
        "XD430-T210": {"velocity_limit": 210, "position_p_gain": 900},
        "XD430-T350": {"velocity_limit": 130, "position_p_gain": 900},
        "XM540-W150": {"velocity_limit": 230},
        "XM540-W270": {"velocity_limit": 128},
        "XH540-W150": {"velocity_limit": 300},
        "XH540-W270": {"velocity_limit": 167},
        "XH540-V150": {"velocity_limit": 230},
        "XH540-V270": {"velocity_limit": 128},
        "XD540-T150": {"velocity_limit": 300},
        "XD540-T270": {"velocity_limit": 167},
        "XW430-T200": {"velocity_limit": 235, "position_p_gain": 900},
        "XW430-T333": {"velocity_limit": 139, "position_p_gain": 900},
        "XW540-T140": {"velocity_limit": 304},
        "XW540-T260": {"velocity_limit": 167},
        "XW540-H260": {"velocity_limit": 145},
        "XL430-W250": {
            "velocity_limit": 265,
            "temperature_limit": 72,
            "velocity_i_gain": 1000,
            "position_d_gain": 4000,
            "position_p_gain": 640,
        },
        "XC430-W150": {"velocity_limit": 460, "moving_threshold": 20, "position_p_gain": 460},
        "XC430-W240": {"velocity_limit": 306, "position_p_gain": 700},
        "2XL430-W250": {
            "velocity_limit": 250,
            "temperature_limit": 72,
            "velocity_i_gain": 1800,
            "position_d_gain": 2000,
            "position_p_gain": 640,
        },
        "2XC430-W250": {"velocity_limit": 275, "position_p_gain": 700},
    }
)
"""Register values by model; others are the family's"""
