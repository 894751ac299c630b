"""The lesson in a headless Chromium: each step says what the two running servos do."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator

import pytest

from tests.browser.test_page import place, press, program
from tests.support.chromium import Tab

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]
TEXT = "document.getElementById('text').innerText"
STARTED = f"{TEXT}.includes('stable on this servo')"
PATIENT_S = 120.0
"""A machine that runs tests may let a change wait"""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """The address of a running demo."""
    with program("demo") as (_, found):
        yield found


@pytest.fixture
def own() -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A demo for one test, and its address."""
    with program("demo") as found:
        yield found


def run_of(child: subprocess.Popen[str], servo: str) -> int:
    """The process of a servo's run."""
    words = ["pgrep", "-P", str(child.pid), "-f", f"/{servo}/run.hwlog"]
    return int(subprocess.run(words, capture_output=True, text=True, check=True).stdout)


def state(servo: str) -> str:
    return f"document.querySelector('#{servo} .state').textContent"


def go(tab: Tab, step: int) -> None:
    """Go to a step, by its dot."""
    tab.value(f"document.querySelectorAll('#dots button')[{step - 1}].click()")
    assert tab.value("document.getElementById('title').textContent").startswith(f"{step}. ")


def scene(tab: Tab, name: str) -> None:
    """Wait until both servos have a wall of the lesson."""
    for servo in ("free", "guarded"):
        tab.wait(
            f"document.querySelector('#{servo}') && window.lesson.{servo}.told?.scene === '{name}'"
            f" && window.lesson.{servo}.told.facts.asked.stiffness"
            f" === window.lesson.{servo}.told.scenes['{name}']['wall.stiffness']",
            PATIENT_S,
        )


def test_the_six_steps_are_walked_and_each_says_something_of_its_own(
    tab: Tab, address: str
) -> None:
    tab.open(address)
    tab.wait(STARTED, PATIENT_S)
    said = set()
    for step in range(1, 7):
        assert tab.value("document.getElementById('title').textContent").startswith(f"{step}. ")
        text = tab.wait(TEXT)
        assert "…" not in text and "NaN" not in text and "undefined" not in text
        said.add(text)
        assert tab.value("document.getElementById('back').disabled") is (step == 1)
        last = tab.value("document.getElementById('next').disabled")
        assert last is (step == 6)
        if not last:
            tab.value("document.getElementById('next').click()")
    assert len(said) == 6
    limits = "document.getElementById('limits-own').textContent"
    before = tab.wait(f"{limits}.includes('is stable below') && {limits}")
    tab.value(
        "(() => { const field = document.querySelector('#own [name=delay]'); field.value = 5;"
        " field.dispatchEvent(new Event('input', { bubbles: true })); })()"
    )
    tab.wait(f"{limits} !== {before!r}")
    tab.value(
        "(() => { const field = document.querySelector('#own [name=delay]'); field.value = '';"
        " field.dispatchEvent(new Event('input', { bubbles: true })); })()"
    )
    tab.value("document.querySelector('#own [name=inertia]').value = -1")
    tab.value("document.getElementById('own').dispatchEvent(new Event('input'))")
    tab.wait(f"{limits}.includes('inertia: found')")
    tab.value("document.getElementById('back').click()")
    tab.wait(STARTED.replace("stable on this servo", "Both servos get the request"))


def test_the_unguarded_servo_oscillates_at_step_2_as_theory_says(tab: Tab, address: str) -> None:
    tab.open(address)
    tab.wait(STARTED, PATIENT_S)
    go(tab, 2)
    scene(tab, "stiff")
    words = tab.wait(f"{state('free')}.includes('theory says') && {state('free')}", PATIENT_S)
    found, theory = (float(part.split(" Hz")[0].split()[-1]) for part in words.split(";"))
    assert found == pytest.approx(theory, rel=0.25)
    tab.wait(f"{TEXT}.includes('oscillates at')")


def test_the_guarded_servo_does_not_at_step_5(tab: Tab, address: str) -> None:
    tab.open(address)
    tab.wait(STARTED, PATIENT_S)
    go(tab, 5)
    scene(tab, "stiff")
    tab.wait(f"{state('free')}.startsWith('oscillates')", PATIENT_S)
    tab.wait(f"{state('guarded')} === 'is calm'", PATIENT_S)
    commanded, asked = (
        tab.value(f"window.lesson.guarded.{value}")
        for value in ("now('stiffness')", "told.facts.asked.stiffness")
    )
    assert commanded < 0.9 * asked
    assert tab.value("window.lesson.free.now('stiffness')") == pytest.approx(asked)


def test_a_drag_makes_contact_and_lets_go(tab: Tab, address: str) -> None:
    tab.open(address)
    tab.wait(STARTED, PATIENT_S)
    go(tab, 1)
    scene(tab, "soft")
    position = "window.lesson.guarded.now('position_rad')"
    torque = "window.lesson.guarded.now('torque_nm')"
    box = place(tab, "#guarded .hand")
    y = box["y"] + 0.5 * box["height"]
    tab.mouse("mousePressed", box["x"] + 0.5 * box["width"], y)
    tab.mouse("mouseMoved", box["x"] + 0.2 * box["width"], y)
    tab.wait(f"{position} < -0.1 && {torque} === 0")
    tab.mouse("mouseMoved", box["x"] + 0.9 * box["width"], y)
    tab.wait(f"{position} > 0.13 && {torque} < -0.3")
    tab.mouse("mouseReleased", box["x"] + 0.9 * box["width"], y)
    tab.wait(f"Math.abs({position} - 0.095) < 0.01", PATIENT_S)


def test_a_knob_turns_both_servos_by_the_rule_of_set(tab: Tab, address: str) -> None:
    tab.open(address)
    tab.wait(STARTED, PATIENT_S)
    scene(tab, "soft")
    tab.value("document.getElementById('turn').open = true")
    tab.value(
        "(() => { const field = document.getElementById('wall.stiffness').nextElementSibling;"
        " field.value = 2; field.dispatchEvent(new Event('change')); })()"
    )
    for servo in ("free", "guarded"):
        tab.wait(f"window.lesson.{servo}.told.facts.asked.stiffness === 2", PATIENT_S)


def test_a_run_that_ends_comes_back_with_the_wall_of_the_step(
    tab: Tab, own: tuple[subprocess.Popen[str], str]
) -> None:
    child, address = own
    tab.open(address)
    tab.wait(STARTED, PATIENT_S)
    go(tab, 2)
    scene(tab, "stiff")
    tab.wait("window.lesson.free.store.last > 3", PATIENT_S)  # one that ends at once is an error
    before = tab.value("window.lesson.free.store.last")
    os.kill(run_of(child, "free"), signal.SIGTERM)
    tab.wait(f"window.lesson.free.store.last < {before}", PATIENT_S)
    scene(tab, "stiff")
    tab.wait(f"{state('free')}.startsWith('oscillates')", PATIENT_S)


def test_the_torque_is_heard_and_silenced(tab: Tab, address: str) -> None:
    tab.open(address)
    tab.wait(STARTED, PATIENT_S)
    hear = "document.querySelector('#free .hear')"
    box = place(tab, "#free .hear")
    tab.value(f"{hear}.scrollIntoView({{ block: 'center' }})")
    box = place(tab, "#free .hear")
    press(tab, box["x"] + 10, box["y"] + 10)
    tab.wait(f"{hear}.getAttribute('aria-pressed') === 'true'")
    tab.wait("window.lesson.sound.next > 0")
    assert tab.value("window.lesson.sound.gain.gain.value") <= 0.25
    press(tab, box["x"] + 10, box["y"] + 10)
    tab.wait("window.lesson.sound.servo === null")


def test_nothing_sticks_out_and_the_first_frame_comes(tab: Tab, address: str) -> None:
    for width, height, dark in ((1280, 860, False), (1280, 860, True), (390, 844, False)):
        tab.look(width, height, dark=dark, phone=width < 500)
        tab.open(address)
        tab.wait("document.querySelectorAll('.plane canvas').length === 2", PATIENT_S)
        for step in range(1, 7):
            go(tab, step)
            assert tab.value("document.documentElement.scrollWidth <= innerWidth")
        paint = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? 0"
        tab.wait(f"{paint} > 0", PATIENT_S)


def test_a_demo_that_was_ended_says_so(tab: Tab, own: tuple[subprocess.Popen[str], str]) -> None:
    child, address = own
    tab.open(address)
    tab.wait("window.lesson?.free.hello && window.lesson.guarded.hello", 2.0 * PATIENT_S)
    child.send_signal(signal.SIGINT)
    for servo in ("free", "guarded"):
        tab.wait(f"{state(servo)} === 'ended'", PATIENT_S)
    child.wait(PATIENT_S)
    assert {tab.value(state(servo)) for servo in ("free", "guarded")} == {"ended"}
