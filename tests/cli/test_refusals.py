"""Wrong words are refused in one sentence with exit status 2, before anything is written or moves.

With ``--json`` the sentence is an object too, of one style for every command.
"""

import json
import re
import shlex
from pathlib import Path

import pytest

from haptic_wall.controller.logs.writer import LogWriter
from tests.support.program import Cli
from tests.support.told_logs import metadata, rows

NO_JSON = ("emulate", "init", "demo", "live")
"""Commands whose answer is no object"""
LOOP = "--inertia 0.012 --damping 0.0117 --period 0.001 --delay 0.002"
LOADED = "--load-inertia 0.003 --transmission-stiffness 200"
RECORD = "identify --record a.csv --pendulum-mass"
SPRING = "simulated --set wall.law=spring --out out"
ONLY_WALLS = (
    "wall.law: found spring, wanted wall: only walls are measured; give --set wall.law=wall;"
)
LONG = 300 * "x"

# Words, and parts of the sentence: first of all the field that it is about.
REFUSED = [
    ("", "Missing command; `haptic-wall --help` lists options and arguments"),
    ("rnu", "no command rnu; did you mean run?"),
    ("presets --nosuch", "--nosuch: no such option; `haptic-wall presets --help` lists options"),
    ("delay", "CONFIG: missing; `haptic-wall delay --help` lists options and arguments"),
    (
        "config simulatd",
        "CONFIG simulatd: no such preset .. mean simulated? .. xl330-m288, xm430-w350",
    ),
    # run
    ("run --duration=5s", "--duration: found 5s, wanted seconds above 0, such as 2.5, or inf"),
    ("run --duration -1", "--duration: found -1, wanted seconds above 0"),
    ("run --set=wall.stifness=3", "wall.stifness: unknown; did you mean wall.stiffness?"),
    ("run --stiffness=2", "--stiffness: no such option; a setting is changed with --set"),
    ("run --plot=a.svg", "--plot a.svg: found a name ending in .svg .. .png: pictures are PNG"),
    ("run --plot a.png --no-plot", "--no-plot: found both --plot and --no-plot; leave one of them"),
    ("run --log=-", "--log -: found standard output, wanted a file's name"),
    ("run --log .", "--log: . is a folder; name a file"),
    ("run --log b --plot ./b", "--log and --plot both name b; give each a file of its own"),
    (f"run --log {LONG}", f"--log {LONG}: cannot be written: File name too long; name another"),
    (f"run --plot {LONG}", f"--plot {LONG}: cannot be written: File name too long; name another"),
    ("run --witness b", "--witness: only an emulated bus in its own process keeps a record"),
    ("run --hold b --hold c", "--hold: found two sources, wanted one"),
    ("run --hold page", "--hold: a page can hold the dead man .. add --live --live-control"),
    ("run --hold nowhere", "--hold: nowhere cannot be opened (No such file or directory)"),
    ("run --live simulated", "--live: found 'simulated', wanted HOST:PORT, for example"),
    ("run --live localhost:70000", "--live: found 'localhost:70000', wanted HOST:PORT"),
    ("run --live 'a b:1'", "--live: cannot listen at a b:1"),
    ("run --live-control", "--live-control: found without --live; add --live, or leave it out"),
    ("run --live localhost:0 --set loop.clock=simulated", "--live: .. before it can be watched"),
    # logs
    ("log", "LOG: missing; `haptic-wall log --help` lists options and arguments"),
    ("log nowhere", "LOG nowhere: cannot be read: No such file or directory; wanted a log of run"),
    ("log a.hwlog --from -1", "--from: found -1, wanted a number from 0"),
    ("log a.hwlog --to nan", "--to: found nan, wanted a number from 0"),
    ("log a.hwlog --from 2 --to 1", "--to: found 1, wanted more than --from, which is 2"),
    ("log a.hwlog --from 5", "LOG a.hwlog: holds no rows in that stretch"),
    ("detect no.csv", "LOG no.csv: cannot be read: No such file or directory; wanted a log of run"),
    ("detect a.hwlog --inertia 0", "--inertia: found 0, wanted a number above 0, up to 1e+06"),
    ("detect a.hwlog --delay -1", "--delay: found -1, wanted a number from 0, up to 10"),
    ("detect a.hwlog --coulomb nan", "--coulomb: found nan, wanted a number from 0, up to 1e+06"),
    ("detect a.hwlog --stiffness 0", "--stiffness: found 0, wanted a number above 0"),
    ("detect a.hwlog --wall-position inf", "--wall-position: found inf, wanted a number"),
    ("detect a.hwlog --plot a.pdf", "--plot a.pdf: found .. wanted one ending in .png"),
    ("live a.hwlog --at localhost", "--at: found 'localhost', wanted HOST:PORT"),
    ("demo --at localhost", "--at: found 'localhost', wanted HOST:PORT"),
    # boundary
    ("boundary simulated --set wall.law=damper", "wall.law: found damper, wanted wall"),
    ("boundary", "--inertia: missing; give it, or a CONFIG"),
    ("boundary --rate=3", "--rate: no such option .. `haptic-wall boundary --help` lists options"),
    (
        "boundary --inertai=1",
        "--inertai: no such option .. did you mean --inertia or --load-inertia?",
    ),
    ("boundary --servo=MX-64 --period=0.001", "--delay: missing; give it, or a CONFIG"),
    ("boundary --servo MX-46", "--servo: 'MX-46' is not one of"),
    ("boundary simulated --inertia=1", "--inertia: CONFIG gives this value; leave the option out"),
    ("boundary --set=a=1", "--set: there is no CONFIG; give a preset or a file too"),
    (f"boundary {LOOP} --delay 2", "--delay: found 2, wanted a number from 0, up to 1 s"),
    (f"boundary {LOOP} --delay 0.9", "--delay: 900 periods of 0.001 s, wanted at most 500"),
    (f"boundary {LOOP} --period 1", "--period: found 1, wanted a number above 0, up to 0.5 s"),
    (f"boundary {LOOP} --period nan", "--period: found nan, wanted a number above 0, up to 0.5 s"),
    (f"boundary {LOOP} --inertia 0", "--inertia: found 0, wanted a number above 0"),
    (f"boundary {LOOP} --virtual-damping 1,,2", "--virtual-damping: found , wanted a number"),
    (f"boundary {LOOP} --inertia 1e-300 --damping 1", "inertia is too small: b T / m"),
    (f"boundary {LOOP} --virtual-damping 1e308", "period is too small: (b + B) / (T/2 + t_d)"),
    (f"boundary {LOOP} --plot plane.pdf", "--plot plane.pdf: found .. pictures are PNG"),
    (f"boundary {LOOP} --load-inertia=0.01", "--transmission-stiffness: missing"),
    (f"boundary {LOOP} --transmission-stiffness=1", "--load-inertia: missing; a load needs both"),
    (
        f"boundary {LOOP} {LOADED} --damping 0 --transmission-damping 0",
        "--damping: .. have no damping",
    ),
    # experiments
    ("delay bed.yaml --out .", "servo.torque_limit: found none"),
    ("map xm430-w350 --out out", "CONFIG: found a real servo at /dev/ttyUSB0, wanted a simulated"),
    ("map simulated --kick= --out out", "--kick: found , wanted a number above 0, up to 3 rad"),
    ("map simulated --kick 0 --out out", "--kick: found 0, wanted a number above 0, up to 3 rad"),
    ("map x --workers=x", "--workers: found x, wanted a whole number from 1"),
    ("map --delay-steps=-1", "--delay-steps: found -1, wanted a whole number from 0, up to 1000"),
    ("map simulated --virtual-damping nan --out out", "--virtual-damping: found nan, wanted a"),
    ("sweep --delay-steps=.5", "--delay-steps: found .5, wanted a whole number from 0, up to 1000"),
    ("sweep simulated --virtual-damping=x --out out", "--virtual-damping: found x, wanted a"),
    ("sweep simulated --delay-steps=1 --out out", "--virtual-damping: missing;"),
    ("zwidth simulated --velocity-samples=0", "--velocity-samples: found 0, wanted a whole number"),
    ("acceptance simulated", "--out: missing; `haptic-wall acceptance --help` lists options"),
    ("commission simulated", "--out: missing; `haptic-wall commission --help` lists options"),
    ("paper tabel2 --out out", "ITEM: 'tabel2' is not one of 'table2', 'fig3'"),
    ("paper fig8", "--out: missing;"),
    (f"map {SPRING}", ONLY_WALLS),
    (f"sweep {SPRING} --virtual-damping=0 --delay-steps=0", ONLY_WALLS),
    (f"commission {SPRING}", ONLY_WALLS),
    (f"zwidth {SPRING}", ONLY_WALLS),
    (f"acceptance {SPRING}", ONLY_WALLS),
    # identify
    ("identify", "CONFIG: missing; give a configuration, or --record FILE"),
    ("identify simulated --reach=0.001", "--reach: found 0.001, wanted 0.092 to 3.14 rad"),
    ("identify simulated --plot=x.pdf", "--plot x.pdf: found a name ending in .pdf"),
    ("identify simulated --out=.", "--out: . is a folder; name a file"),
    ("identify simulated --out=/proc/a.yaml", "--out /proc/a.yaml: cannot be written"),
    ("identify simulated --plot=/proc/a.png", "--plot /proc/a.png: cannot be written"),
    ("identify simulated --record a.csv", "--record: found with CONFIG"),
    ("identify --record a.csv --out b --yes", "--record: found with --out and --yes"),
    ("identify --record no.csv", "--record no.csv: cannot be read: No such file or directory"),
    ("identify --record .", "--record .: cannot be read: Is a directory; wanted a CSV"),
    (f"{RECORD} 1", "--pendulum-length: missing beside --pendulum-mass; give both, or neither"),
    (f"{RECORD} 1 --pendulum-length -1", "--pendulum-length: found -1, wanted a number above 0"),
    (f"{RECORD} nan --pendulum-length 1", "--pendulum-mass: found nan, wanted a number above 0"),
    ("identify simulated --pendulum-mass 1 --pendulum-length 1", "--pendulum-mass: found without"),
    # buses
    ("scan --port=", "--port: found nothing, wanted a serial device such as /dev/ttyUSB0"),
    ("scan --port=/dev/null", "--port: found /dev/null .. device, such as /dev/ttyUSB0"),
    ("emulate --servo XM430-W35", "--servo: no model .. did you mean XM430-W350?"),
    ("emulate --servo XL430-W250", "--servo: no model .. the XL430-W250 has no current mode"),
    (f"emulate --servo XM430-W350:{5000 * '9'}", "wanted MODEL[:ID[:FIRMWARE]]"),
    ("emulate --servo XM430-W350:253", "--servo: id 253 of the XM430-W350 .. give 0 to 252"),
    ("emulate --servo XM430-W350:1:300", "--servo: firmware_version 300 .. give 0 to 255"),
    ("emulate --servo XD540-T270", "--servo: .. for the XD540-T270; give servo.torque_constant"),
    ("emulate --servo XL330-M288 --baud 4500000", "--servo: baud_rate 7 of the XL330-M288"),
    ("emulate --baud 12345", "--baud: found 12345, wanted one of 9600, 57600 .. 4000000"),
    ("emulate --baud fast", "--baud: found fast, wanted a whole number from 1, up to 1e+07"),
    ("emulate --set servo.inertai=1", "--set: .. no servo.inertai; did you mean servo.inertia?"),
    (
        "emulate --set servo.inertia",
        "--set: found servo.inertia without a value .. servo.NAME=VALUE",
    ),
    ("emulate --set servo.inertia=0", "--set: servo.inertia: found '0' .. from 1e-08"),
    ("emulate --set servo.counts_per_rev=1.5", "--set: servo.counts_per_rev: .. a whole number"),
    ("emulate --set servo.hand=slap", "--set: servo.hand: found 'slap' .. none, push"),
    ("emulate --set servo.load_friction=1", "--set: servo.load_friction: .. to 0.9"),
    ("emulate --set servo.static_friction=0.05", "servo.static_friction: .. servo.coulomb, 0.09"),
    ("emulate --set servo@.inertia=1", "--set: an emulated servo has no servo@.inertia"),
    ("emulate --set servo@7.inertia=1", "--set: no servo has the id 7"),
    ("emulate --set arm.length_3=1", "--set: .. no arm.length_3; did you mean arm.length_"),
    ("emulate --set arm.length_1=0", "--set: arm.length_1: found '0' .. above 0"),
    ("emulate --set arm.mass_1=0.2", "--set: found arm.mass_1 .. add --arm planar"),
    ("emulate --arm planar", "arm.shape: found 1 servo, wanted two servos for two links"),
    ("emulate --latency-timer 1.5", "--latency-timer: found 1.5 .. up to 255"),
    ("emulate --latency-timer 1 --block 0", "--block: found 0, wanted a whole number from 1"),
    ("emulate --fault drp:p=0.1", "--fault: no fault is called 'drp'; did you mean drop?"),
    ("emulate --fault unplug:at=2,id=7", "--fault unplug:at=2,id=7: no servo .. ids here are 1"),
    ("emulate --record /proc/no/such.csv", "--record /proc/no/such.csv: cannot be written"),
    # init
    ("init simulated", "FILE simulated: found the name of a preset .. --from simulated"),
    ("init a.yaml --axes 1,1", "--axes: found 1 twice, wanted an id for each servo"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, a CSV and a configuration, which nothing may change."""
    folder = tmp_path_factory.mktemp("refused")
    with LogWriter(folder / "a.hwlog", metadata()) as log:
        log.append(rows(200)[:, None])
    (folder / "a.csv").write_text("time_s,position_rad\n0,0\n")
    (folder / "bed.yaml").write_text(
        "servo: {backend: dynamixel, port: /dev/none, baud: 4000000, model: XM430-W350}\n"
        "model: {inertia: 0.012, damping: 0.01, coulomb: 0.09, delay: 0.001, torque_gain: 1}\n"
    )
    return folder


@pytest.mark.parametrize(("words", "said"), REFUSED, ids=lambda text: text[:60])
def test_wrong_words_are_refused(
    words: str, said: str, cli: Cli, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    given = shlex.split(words)
    message = cli.refused(*given)
    assert all(part in message for part in said.split(" .. ")), message
    if given and given[0] not in NO_JSON:
        status, out, err = cli(*given, "--json")
        found = json.loads(out)
        assert set(found) == {"error", "field", "advice", "exit_status"}
        assert (status, found["exit_status"], err) == (2, 2, message)
        field = re.match(r"--[a-z-]+|[A-Z]+|[a-z]+\.[a-z_]+", said)
        assert found["field"] == (field and field[0])
        assert found["error"].splitlines()[0] in message
        assert found["error"].endswith(found["advice"] or "")
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    "words",
    [
        "delay --out new",
        "identify --out new/one.yaml",
        "sweep --out new --virtual-damping 0 --delay-steps 0",
    ],
)
def test_a_folder_that_was_made_in_vain_is_removed(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    command, *rest = words.split()
    answer = cli(command, "xm430-w350", "--set", "servo.port=/dev/null", "--yes", *rest)
    assert answer.status == 4
    assert not list(tmp_path.iterdir())
