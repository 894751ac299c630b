"""The live page in a headless Chromium: it shows what the run does."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.chromium import Tab
from tests.support.program import PROGRAM, call

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]
STATE = "document.getElementById('state').textContent"
SHOWN = f"{STATE}.includes(' s · K')"


@contextmanager
def program(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A command of ours, and the address that it prints."""
    child = subprocess.Popen(
        [*PROGRAM, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        process_group=0,
    )
    try:
        assert child.stdout is not None
        for line in child.stdout:
            if "http://" in line:
                yield child, line[line.index("http://") :].strip()
                break
    finally:
        child.send_signal(signal.SIGINT)
        child.communicate(timeout=30.0)


@contextmanager
def running(folder: Path, *more: str, config: str = "simulated") -> Iterator[str]:
    """A wall that is pushed, and the address of its page."""
    run = ["run", config, "--no-plot", "--log", str(folder / "a.hwlog"), "--duration", "120"]
    with program(*run, "--set", "servo.hand=push", "--live", *more) as (_, address):
        yield address


def recorded(folder: Path) -> Path:
    """The log of a run of 3 s."""
    log = folder / "b.hwlog"
    run = ["run", "simulated", "--no-plot", "--log", log, "--set", "loop.clock=simulated"]
    assert call(*run, "--duration", 3) == 0
    return log


def place(tab: Tab, selector: str) -> dict[str, float]:
    """Where an element is on the screen, as soon as it is there."""
    found: dict[str, float] = tab.wait(
        f"(() => {{ const {{ x, y, width, height }} = document.querySelector('{selector}')"
        ".getBoundingClientRect(); return width && { x, y, width, height }; })()"
    )
    return found


def press(tab: Tab, x: float, y: float) -> None:
    """Click there."""
    tab.mouse("mouseMoved", x, y, buttons=0)
    tab.mouse("mousePressed", x, y)
    tab.mouse("mouseReleased", x, y)


POSITION = "parseFloat(document.querySelector('.label b').textContent)"


def drag(tab: Tab) -> tuple[float, float]:
    """Drag the hand into the wall, and hold it there; return where it is."""
    box = place(tab, "#hand")
    x, y = box["x"] + 0.9 * box["width"], box["y"] + 0.5 * box["height"]
    tab.mouse("mousePressed", box["x"] + 0.45 * box["width"], y)
    tab.mouse("mouseMoved", x, y)
    tab.wait(f"{POSITION} > 0.02")
    return x, y


def ask(tab: Tab, path: str, value: float) -> None:
    """Turn a knob by its number."""
    tab.value(
        f"(() => {{ const field = document.getElementById('{path}').nextElementSibling;"
        f" field.value = {value}; field.dispatchEvent(new Event('change')); }})()"
    )


def test_the_curve_moves_and_the_page_complains_of_nothing(tab: Tab, tmp_path: Path) -> None:
    with running(tmp_path) as address:
        tab.open(address)
        tab.wait(SHOWN)
        seconds = "parseFloat(document.getElementById('state').textContent)"
        before = tab.value(seconds)
        drawn = "document.querySelector('#panels canvas').toDataURL()"
        first = tab.value(drawn)
        tab.wait(f"{seconds} > {before} + 0.5")
        assert tab.value(drawn) != first
        tab.wait("document.querySelectorAll('#marks li.wall').length > 0")
        tab.value("document.getElementById('pause').click()")
        tab.wait("document.getElementById('pause').textContent === 'Continue'")
        held = tab.value("document.getElementById('panels').dataset.to")
        tab.wait(f"{seconds} > {before} + 1.0")
        assert tab.value("document.getElementById('panels').dataset.to") == held
    tab.wait(f"{STATE}.includes('the run is over: interrupted')")
    assert tab.value("document.getElementById('marks').innerText").strip()


def test_times_are_measured_from_a_pin(tab: Tab, tmp_path: Path) -> None:
    log = recorded(tmp_path)
    with program("live", str(log)) as (_, address):
        tab.open(address)
        tab.wait(f"{STATE}.includes('the run ended: duration')")
        box = place(tab, ".u-over")
        low, high = box["x"] + 0.25 * box["width"], box["x"] + 0.5 * box["width"]
        y = box["y"] + 0.5 * box["height"]
        press(tab, low, y)
        tab.mouse("mouseMoved", high, y, buttons=0)
        words = tab.wait(
            "(() => { const text = document.getElementById('readout').textContent;"
            " return text.startsWith('from the pin') && text; })()"
        )
        assert float(words.split("Δt ")[1].split()[0]) == pytest.approx(750.0, abs=10.0)


def test_nothing_sticks_out(tab: Tab, tmp_path: Path) -> None:
    with running(tmp_path) as address:
        for width, height, dark in ((1280, 860, False), (1280, 860, True), (390, 844, False)):
            tab.look(width, height, dark=dark, phone=width < 500)
            tab.open(address)
            tab.wait(SHOWN)
            assert tab.value("document.documentElement.scrollWidth <= innerWidth")


def test_a_knob_raises_the_stiffness_to_the_clamp_and_says_why(tab: Tab, tmp_path: Path) -> None:
    with running(tmp_path, "--live-control") as address:
        tab.open(address)
        tab.wait(SHOWN)
        tab.wait("document.querySelector('#plane canvas') !== null")
        words = "not applied"
        for _ in range(3):  # a busy machine may find no moment that suits
            if "not applied" in words:
                ask(tab, "wall.stiffness", 5000)
                words = tab.wait(
                    "(() => { const text = document.querySelector('#rows .answer').textContent;"
                    " return ['the guard allows', 'not applied']"
                    ".some((each) => text.includes(each)) && text; })()",
                    40.0,
                )
        assert "the guard allows" in words and "5000" in words
        tab.wait("document.getElementById('reasons').textContent.includes('5000')")
        tab.wait(
            "[...document.querySelectorAll('#marks li.change')].some((mark) => "
            "mark.innerText.includes('wall.stiffness=5000'))"
        )


def test_an_alarm_appears_and_what_was_done(tab: Tab, tmp_path: Path) -> None:
    """The servo is later than the guard believes, so that the wall swings; it is made softer."""
    sets = ["servo.delay=0.006", "model.delay=0.001", "servo.coulomb=0", "servo.hand=none"]
    sets += ["servo.kick=0.3", "wall.side=both", "wall.damping=0", "wall.stiffness=20"]
    with running(tmp_path, *(word for each in sets for word in ("--set", each))) as address:
        tab.open(address)
        words = tab.wait("document.querySelector('#marks li.alarm span')?.textContent")
        assert words.startswith("oscillation: ")
        softer = tab.wait("document.querySelector('#marks li.reduction span')?.textContent")
        before, after = (
            float(each.split()[0]) for each in softer[len("stiffness ") :].split(" → ")
        )
        assert after < before <= 20.0
        tab.wait("document.getElementById('reasons').textContent.includes('an oscillation')")


def test_the_page_says_what_of_three_makes_the_wall_softer_now(tab: Tab, shown: str) -> None:
    tab.open(shown)
    tab.value("import('./map.js').then(({ GuardMap }) => { window.GuardMap = GuardMap; })")
    for delay, softer, cause in (
        (0.001, "true", "an oscillation"),
        (0.002, "false", "the delay is 2.00 ms, not 1.00 ms"),
        (0.001, "false", "the guard counts a longer period"),
    ):
        words = tab.value(
            "(() => { const map = { delay: 0.001, commanded: { stiffness: 8 }, reasons: [] },"
            f" words = {{}}, point = [2, 0.02, {delay}, {softer}];"
            " GuardMap.prototype.explain.call("
            "Object.assign(Object.create(GuardMap.prototype), { map, words, point }));"
            " return words.textContent; })()"
        )
        assert words.startswith("Now only 2 N·m/rad, because ") and cause in words


def test_the_wall_is_on_while_the_button_is_held(tab: Tab, tmp_path: Path) -> None:
    more = ["--live-control", "--hold", "page", "--set", "servo.hand=none"]
    with running(tmp_path, *more) as address:
        tab.open(address)
        tab.wait(SHOWN)
        box = place(tab, "#hold")
        middle = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
        newest = "document.querySelector('#marks li.wall')?.innerText ?? ''"
        assert tab.value(newest) == ""
        off = "getComputedStyle(document.getElementById('off')).visibility"
        tab.wait(f"{off} === 'visible'")
        tab.mouse("mousePressed", *middle)
        tab.wait(f"({newest}).includes('is on') && {off} === 'hidden'")
        tab.mouse("mouseReleased", *middle)
        tab.wait(f"({newest}).includes('is off') && {off} === 'visible'")
        tab.mouse("mousePressed", *middle)
        tab.wait(f"{off} === 'hidden'")
    tab.wait(f"{STATE}.includes('the run is over') && {off} === 'visible'")


def test_without_the_token_the_knobs_are_fixed(tab: Tab, tmp_path: Path) -> None:
    with running(tmp_path, "--live-control") as address:
        tab.open(address.partition("?")[0])
        tab.wait(SHOWN)
        assert tab.value("[...document.querySelectorAll('#rows input')].every((i) => i.disabled)")


def test_a_hand_drags_the_shaft_into_the_wall_and_lets_go(tab: Tab, tmp_path: Path) -> None:
    with running(tmp_path, "--live-control", "--set", "servo.hand=none") as address:
        tab.open(address)
        tab.wait(SHOWN)
        tab.wait("document.querySelectorAll('#marks li.wall').length > 0")
        tab.mouse("mouseReleased", *drag(tab))
        tab.wait(f"{POSITION} < 0.05")


def test_the_hand_holds_the_axis_that_is_shown(tab: Tab, tmp_path: Path) -> None:
    arm = tmp_path / "arm.yaml"
    one = Path(__file__).parents[2] / "config" / "simulated.yaml"
    arm.write_text(f"{one.read_text()}\naxes: {{elbow: {{}}, wrist: {{}}}}\n")
    more = "--live-control", "--set", "servo.hand=none"
    with running(tmp_path, *more, config=str(arm)) as address:
        tab.open(address)
        tab.wait(SHOWN)
        tab.wait("document.querySelectorAll('#strip button').length === 2")
        elbow, wrist = (f"document.querySelectorAll('#strip button')[{k}]" for k in (0, 1))
        tab.value(f"{wrist}.click()")
        tab.wait(f"{wrist}.getAttribute('aria-pressed') === 'true'")
        held = drag(tab)
        tab.value(f"{elbow}.click()")
        tab.wait(f"{POSITION} < 0.01")
        tab.mouse("mouseReleased", *held)


def test_a_run_that_trips_has_no_wall(tab: Tab, tmp_path: Path) -> None:
    sets = ["--set", "safety.travel=[-0.5, 0.001]", "--set", "servo.hand=lean"]
    with running(tmp_path, *sets) as address:
        tab.open(address)
        tab.wait(f"{STATE}.includes('trip:travel')")
        tab.wait("getComputedStyle(document.getElementById('off')).visibility === 'visible'")


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a recorded run."""
    with program("live", str(recorded(tmp_path_factory.mktemp("shown")))) as (_, address):
        yield address


KNOBS = """(async () => {
  const { Knobs } = await import("./knobs.js"), root = document.getElementById("rows");
  root.replaceChildren();
  window.sent = [];
  window.knobs = new Knobs(root, (what) => sent.push(what));
  const detents = { numbers: ["count", "width", "snap"], example: { count: 24, snap: 0.4 } };
  const laws = { wall: { numbers: ["side"], example: {} }, spring: { numbers: [], example: {} },
    friction: { numbers: ["friction"], example: { friction: 0.1 } }, detents };
  const none = { low: null, high: null, count: null, width: null, friction: null, period: null };
  const wall = { law: "wall", side: "above", stiffness: 8, damping: 0.02, position: Math.PI,
    snap: 0.25, ...none };
  window.show = (changes, travel = null) =>
    knobs.show({ wall: { ...wall, ...changes }, delay_steps: 0, travel }, { controls: true, laws });
  show({});
})()"""
SECTIONS = (
    "[...document.querySelectorAll('main section, .knob, h2')]"
    ".map((each) => { const { x, y, width, height } = each.getBoundingClientRect();"
    " return [x, y, width, height]; })"
)
ANSWER = "document.querySelector('#rows .answer').textContent"


def test_an_answer_moves_nothing_and_goes_with_the_next_wish(tab: Tab, shown: str) -> None:
    for width in (1280, 390):
        tab.look(width, 860, phone=width < 500)
        tab.open(shown)
        tab.wait(f"{STATE}.includes('the run ended')")
        tab.value(KNOBS)
        before = tab.value(SECTIONS)
        ask(tab, "wall.stiffness", 5000)
        assert tab.value(ANSWER) == "asked"
        tab.value("knobs.answer({ id: knobs.count, error: 'no such wall, '.repeat(60) })")
        assert tab.value(ANSWER).startswith("no such wall")
        assert tab.value("knobs.rows['wall.stiffness'].number.value") == "8", "it is in force"
        assert tab.value(SECTIONS) == before
        ask(tab, "wall.damping", 0.1)
        tab.value("knobs.answer({ id: knobs.count - 1, error: 'late' })")
        assert tab.value(ANSWER) == "asked"
        tab.wait("sent.length > 0")
        tab.value("knobs.answer({ id: knobs.count, applied: true })")
        assert tab.value(ANSWER) == ""
        assert tab.value(SECTIONS) == before


@pytest.mark.parametrize(
    ("travel", "position", "low", "high"),
    [
        (None, 3.14159, 0.0, 6.2832),
        ([-2.0, 4.0], 3.14159, -2.0, 4.0),
        ([-20.0, 20.0], 0.0, -20.0, 20.0),
        ([-2.0, 1.0], 1.5, -2.0, 1.5),
    ],
)
def test_the_positions_slider_spans_the_travel_and_a_touch_asks_for_nothing(
    tab: Tab, shown: str, travel: list[float] | None, position: float, low: float, high: float
) -> None:
    tab.open(shown)
    tab.wait(f"{STATE}.includes('the run ended')")
    tab.value(KNOBS)
    tab.value(f"show({{ position: {position}, stiffness: 5000 }}, {travel or 'null'})")
    for path, value in (("wall.position", position), ("wall.stiffness", 5000.0)):
        slider = f"document.getElementById('{path}')"
        least, most = tab.value(f"[+{slider}.min, +{slider}.max]")
        if path == "wall.position":
            assert (least, most) == pytest.approx((low, high), abs=1e-4)
        box = place(tab, f'[id="{path}"]')
        y = box["y"] + 0.5 * box["height"]
        for part in (0.02, 0.3, 0.5, 0.98):
            press(tab, box["x"] + part * box["width"], y)
        assert tab.value("[sent, knobs.timer]") == [[], None]
        x = box["x"] + 0.5 * box["width"]
        tab.mouse("mousePressed", x, y)
        tab.mouse("mouseMoved", x - 2.0, y)
        tab.mouse("mouseReleased", x - 2.0, y)
        (found,) = tab.wait("sent.length > 0 && sent")
        tab.value("sent.length = 0")
        assert value - 4.0 * (most - least) / box["width"] < found["set"][path] < value


def test_a_law_has_the_knobs_of_its_numbers(tab: Tab, shown: str) -> None:
    tab.open(shown)
    tab.wait(f"{STATE}.includes('the run ended')")
    tab.value(KNOBS)
    for changes, own in (
        ("{}", {"side"}),
        ("{ law: 'spring' }", set()),
        ("{ law: 'detents', count: 24 }", {"count", "snap"}),
        ("{ law: 'detents', width: 0.2 }", {"width", "snap"}),
        ("{ law: 'friction', friction: 0.1 }", {"friction"}),
        ("{ law: 'profile' }", set()),
    ):
        tab.value(f"show({changes})")
        seen = tab.value(
            "[...document.querySelectorAll('#rows .knob')].filter((row) => row.offsetHeight)"
            ".map((row) => row.querySelector('label').textContent)"
        )
        assert set(seen) == own | {"stiffness", "damping", "position", "delay", "law"}
    assert "rad 180.0°" in tab.value("document.getElementById('rows').innerText")
    choose = "(() => { const law = document.getElementById('law'); law.value = 'detents';"
    tab.value(choose + " law.dispatchEvent(new Event('change')); })()")
    (found,) = tab.wait("sent.length > 0 && sent")
    assert found["set"] == {"wall.law": "detents", "wall.count": 24, "wall.snap": 0.4}


SCOPE = """(async () => {
  const { Scope, PANELS } = await import("./scope.js");
  const { Store } = await import("./store.js");
  const names = ["position_rad", "wall_torque_nm", "torque_nm", "measured_torque_nm"];
  const store = new Store(1000, names), root = document.getElementById("panels");
  root.replaceChildren();
  for (let k = 0; k < 1000; k++) {
    store.time[k] = k / 100;
    for (const name of names) store.columns[name][k] = name === names[3] ? 0.25 : 0;
  }
  store.length = 1000;
  const torque = (edge) => Array.from({ length: 401 }, (_, k) => Math.min(0, edge + 2 - k / 100));
  const law = (since, edge) => ({ since, name: "wall", low: -2, high: 2, surface: edge,
    edges: [edge], torque: torque(edge) });
  const state = { laws: [law(0, 0.5), law(6, 1)], marks: [], pin: null };
  window.scope = new Scope(root, store, state, {}, { panels: PANELS.slice(0, 2) });
  scope.draw([0, 10]);
  scope.label(999);
  await new Promise(requestAnimationFrame);
  const [plot] = scope.plots, { ctx } = plot;
  const pixel = (x, y) => ctx.getImageData(x, y, 1, 1).data[3];
  window.shade = (time, position) =>
    pixel(plot.valToPos(time, "x", true), plot.valToPos(position, "y", true));
})()"""


def test_a_shaft_at_rest_has_its_wall_in_view_and_a_law_shades_its_own_time(
    tab: Tab, shown: str
) -> None:
    tab.open(shown)
    tab.wait(f"{STATE}.includes('the run ended')")
    tab.value(SCOPE)
    scale = "(({ min, max }) => [min, max])(scope.plots[0].scales.y)"
    low, high = tab.value(scale)
    assert low < 0.0 and 1.0 < high < 1.3
    grid = "[1.3, 4.4, 7.3, 8.7].map((time) => shade(time, {}))"
    assert [each > 0 for each in tab.value(grid.format(0.83))] == [True, True, False, False]
    assert all(tab.value(grid.format(1.03)))
    assert not any(tab.value(grid.format(0.23)))
    tab.value("scope.draw([0, 5])")
    tab.wait(f"{scale}[1] < 0.7 && {scale}[1] > 0.5")
    labels = tab.value("scope.labels.map((label) => label.textContent)")
    assert "0.000 rad (0.0°)" in labels[0]
    assert "measured 0.250" in labels[1]
    tab.value("scope.store.columns.measured_torque_nm.fill(NaN); scope.label(999)")
    assert "measured" not in tab.value("scope.labels[1].textContent")
