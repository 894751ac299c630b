"""Simulates many loops in lanes: the array loop of ``many_walls``, written to be compiled.

The operations and their order are those of ``many_walls`` and of the arrays in
``haptic_wall.hw.plant``, so that each rigid servo moves to the last bit as there. A few walls at a
time, one in each lane, run through all periods in a workspace that stays in the first-level cache.
Each pass over the lanes has no branches, so that a compiler makes vector instructions of it;
servos that come to rest within a step are rare and are solved one by one.

The functions are plain Python and give the same results uncompiled, thousands of times slower. Each
``lane_*`` module has one part; ``compiled`` compiles them all.
"""

from __future__ import annotations

import numpy as np

from haptic_wall.controller.experiments.maps.lane_bodies import (
    follow,
    rest,
    slide,
    slide_or_stick,
    slide_turning,
)
from haptic_wall.controller.experiments.maps.lane_drives import aim, drive
from haptic_wall.controller.experiments.maps.lane_laws import follow_table
from haptic_wall.controller.experiments.maps.lane_loop import command, delayed, limit, sense
from haptic_wall.controller.experiments.maps.lane_observers import (
    gone,
    look,
    look_at_loads,
    stay,
    turn,
)
from haptic_wall.controller.experiments.maps.lane_rows import (
    CONTACTS,
    DRIVES,
    DRIVES_ROWS,
    FIXED,
    FOLLOWED,
    FRICTIONAL,
    HELD,
    IN_CONTACT,
    IS_LIMITED,
    KEPT,
    LAGS,
    LANES,
    LATE,
    LOADS,
    LOADS_ROWS,
    OBSERVER,
    PARTS,
    PLAY,
    POSITION,
    ROWS,
    SAMPLES,
    SEEN,
    STEPS,
    TORQUE,
    TURNINGS,
    VELOCITY,
)
from haptic_wall.controller.experiments.maps.lane_two_masses import swing
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.plant.many_two_masses import TERMS


def move(w: FloatArray, traits: IntArray, over: FloatArray) -> None:
    """Move rigid servos under the acting torques over a step."""
    few = 0
    if traits[PLAY]:
        few = slide_turning(w, over)
    elif traits[FRICTIONAL]:
        few = slide_or_stick(w, over)
    else:
        slide(w, over)
    if few:
        rest(w, over, traits[PLAY] != 0)
    if traits[PLAY]:
        follow(w)


def act_plainly(w: FloatArray, traits: IntArray, over: FloatArray) -> None:
    """Move servos without either for a part of a period; ``act`` costs them some per cent."""
    move(w, traits, over)
    if traits[OBSERVER] == CONTACTS:
        look(w, over)


def act(
    w: FloatArray,
    traits: IntArray,
    over: FloatArray,
    loads: FloatArray,
    drives: FloatArray,
    terms: FloatArray,
    part: int,
) -> None:
    """Move servos with a load or a current loop for a part of a period.

    The part is 0 before the torque changes, and 1 after it.
    """
    if drives.shape[0]:
        aim(w, drives)
    for _ in range(max(1, traits[STEPS + part])):
        if drives.shape[0]:
            drive(w, drives, loads, part)
        if loads.shape[0]:
            swing(w, loads, terms, part, traits[PARTS + part])
        else:
            move(w, traits, over)
    if traits[OBSERVER] != CONTACTS:
        return
    if loads.shape[0]:
        look_at_loads(w, loads)
    else:
        look(w, over)


def extra(
    part: FloatArray, fixed: FloatArray, state: FloatArray, rows: int, first: int, lanes: int
) -> None:
    """Copy what only some servos have into its workspace: ``rows`` of it, then its state."""
    for i in range(LANES if part.shape[0] else 0):
        wall = first + min(i, lanes - 1)
        for row in range(rows):
            part[row * LANES + i] = fixed[row, wall]
        for row in range(state.shape[0]):
            part[(rows + row) * LANES + i] = state[row, wall]


def back(part: FloatArray, state: FloatArray, rows: int, first: int, lanes: int) -> None:
    """Copy the state back."""
    for i in range(lanes if part.shape[0] else 0):
        for row in range(state.shape[0]):
            state[row, first + i] = part[(rows + row) * LANES + i]


def load(
    w: FloatArray,
    fixed: FloatArray,
    seen: FloatArray,
    body: FloatArray,
    first: int,
    lanes: int,
) -> None:
    """Copy walls into the workspace; lanes that are left over get the last one."""
    for i in range(LANES):
        wall = first + min(i, lanes - 1)
        for row in range(FIXED):
            w[row * LANES + i] = fixed[row, wall]
        for row in range(SEEN):
            w[(FIXED + row) * LANES + i] = seen[row, wall]
        for row in range(3):
            w[(POSITION + row) * LANES + i] = body[row, wall]


def store(
    w: FloatArray,
    traits: IntArray,
    seen: FloatArray,
    body: FloatArray,
    first: int,
    lanes: int,
) -> None:
    """Copy walls back from the workspace."""
    following = FOLLOWED if traits[PLAY] else POSITION
    for i in range(lanes):
        for row in range(SEEN):
            seen[row, first + i] = w[(FIXED + row) * LANES + i]
        body[0, first + i] = w[POSITION * LANES + i]
        body[1, first + i] = w[VELOCITY * LANES + i]
        body[2, first + i] = w[following * LANES + i]


def trace(w: FloatArray, course: FloatArray, row: int, first: int, lanes: int) -> None:
    """Record the positions, where that is wanted."""
    for i in range(lanes if course.shape[0] else 0):
        course[row, first + i] = w[POSITION * LANES + i]


def among(delays: IntArray, first: int, last: int) -> tuple[int, int]:
    """Return the first delay, and the one behind the last, of these walls."""
    least, most = 0, delays.shape[0]
    while delays[least, 2] <= first:
        least += 1
    while delays[most - 1, 1] >= last:
        most -= 1
    return least, most


def run(  # noqa: PLR0912 - its parts as functions make it some per cent slower
    k: int,
    periods: int,
    traits: IntArray,
    delays: IntArray,
    fixed: FloatArray,
    hands: FloatArray,
    seen: FloatArray,
    body: FloatArray,
    measured: FloatArray,
    torques: FloatArray,
    turned: FloatArray,
    course: FloatArray,
    loads_fixed: FloatArray,
    masses: FloatArray,
    drives_fixed: FloatArray,
    currents: FloatArray,
    table: FloatArray,
) -> int:
    """Simulate all walls for some periods, in place.

    Args:
        k: Periods before.
        periods: Number of periods.
        traits: What the walls are, all alike; see ``ONE_SIDED`` and the following.
        delays: Whole periods, first and last wall of each delay, rising, shape (delays, 3).
        fixed: What does not change, shape (FIXED, n).
        hands: Torques of an operator [N·m], a row for each period, of which the last one stays;
            shape (rows, n); without rows: none.
        seen: What the observer remembers, shape (SEEN, n).
        body: Position, velocity and followed position, shape (3, n).
        measured: Measured positions [rad], a ring buffer with a row per period, shape (rows, n).
        torques: Commanded torques [N·m], the same.
        turned: Wall, period, velocities before and after, and position before of each turning
            point; shape (5, room).
        course: Gets the positions after each period [rad], shape (periods, n), or has no rows.
        loads_fixed: Of servos with a load, shape (LOADS, n); else without rows.
        masses: Twist, speeds of motor and output, and position of the output, shape (4, n).
        drives_fixed: Of servos with a current loop, shape (DRIVES, n); else without rows.
        currents: Voltage and velocity at the last step, shape (2, n).
        table: Positions and elongations of a law [rad], shape (2, rows); without rows: walls.

    Returns:
        The number of turning points.
    """
    w, late, held = np.zeros(ROWS * LANES), np.zeros(4 * LANES), np.zeros(4 * LANES)
    loads = np.zeros(LOADS_ROWS * LANES if loads_fixed.shape[0] else 0)
    drives = np.zeros(DRIVES_ROWS * LANES if drives_fixed.shape[0] else 0)
    kept = np.zeros(KEPT * LANES if table.shape[0] else 0)  # from 0 to 0: nobody is in it
    terms = np.zeros((5, TERMS))
    plain = loads.shape[0] + drives.shape[0] == 0
    walls = fixed.shape[1]
    count = 0
    for first in range(0, walls, LANES):
        lanes = min(LANES, walls - first)
        load(w, fixed, seen, body, first, lanes)
        if gone(w, traits):
            continue
        extra(loads, loads_fixed, masses, LOADS, first, lanes)
        extra(drives, drives_fixed, currents, DRIVES, first, lanes)
        for i in range(4 * LANES):
            late[i], held[i] = w[LATE * LANES + i], w[HELD * LANES + i]
        least, most = among(delays, first, first + lanes)
        for now in range(k, k + periods):
            ago = min(now, traits[SAMPLES])
            sense(w, traits, measured, first, lanes, now, ago, k)
            if table.shape[0]:
                follow_table(w, table, kept, traits[IN_CONTACT] != 0, ago)
            else:
                command(w, ago)
            limit(w, traits)
            row = now % torques.shape[0]
            for i in range(lanes):
                torques[row, first + i] = w[TORQUE * LANES + i]
            if traits[LAGS]:
                before = row - 1 if row else torques.shape[0] - 1
                delayed(w, delays, torques, hands, first, lanes, before, now - k, least, most)
                if plain:
                    act_plainly(w, traits, late)
                else:
                    act(w, traits, late, loads, drives, terms, 0)
            delayed(w, delays, torques, hands, first, lanes, row, now - k, least, most)
            if plain:
                act_plainly(w, traits, held)
            else:
                act(w, traits, held, loads, drives, terms, 1)
            if traits[OBSERVER] == CONTACTS:
                stay(w)
            elif traits[OBSERVER] == TURNINGS:
                count = turn(w, first, lanes, now + 1, traits[IS_LIMITED] != 0, turned, count)
            trace(w, course, now - k, first, lanes)
        store(w, traits, seen, body, first, lanes)
        back(loads, masses, LOADS, first, lanes)
        back(drives, currents, DRIVES, first, lanes)
    return count
