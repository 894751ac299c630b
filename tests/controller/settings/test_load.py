"""Reading a configuration: what people write is understood, and all that is wrong is said."""

import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.controller.errors import ConfigError, UserError
from haptic_wall.controller.settings.fields import fields, sections
from haptic_wall.controller.settings.load import (
    MOST_BYTES,
    apply_set,
    load_config,
    preset_names,
    preset_summary,
    preset_text,
)
from haptic_wall.controller.settings.yaml_text import parse

HARDWARE = "xm430-w350"


def problems(source: str | Path, *sets: str) -> Sequence[str]:
    with pytest.raises(ConfigError) as refused:
        load_config(str(source), sets)
    assert refused.value.exit_status == 2
    return refused.value.problems


def only(source: str | Path, *sets: str) -> str:
    (problem,) = problems(source, *sets)
    return problem


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_loads_and_says_what_it_is_for(name: str) -> None:
    assert load_config(name).config.loop.rate_hz == (500.0 if "arm" in name else 1000.0)
    assert 20 < len(preset_summary(name)) < 100


def test_the_comments_of_the_presets_name_settings_that_exist() -> None:
    comments = " ".join(re.findall("#.*", "".join(map(preset_text, preset_names()))))
    named = set(re.findall(r"\b[a-z]+(?:_[a-z]+)+\b", comments))
    assert named <= {path.rpartition(".")[2] for path in fields()}


@pytest.mark.parametrize("name", preset_names())
def test_hardware_presets_are_strict_and_the_others_are_not(name: str) -> None:
    """emulated-port drives an emulated bus through a port, which hurts nobody."""
    config = load_config(name).config
    strict = config.servo.kind == "hardware" and name != "emulated-port"
    assert (config.realtime.profile == "strict") == strict


def test_a_file_that_names_hardware_is_strict_unless_it_says_otherwise(tmp_path: Path) -> None:
    text = "\n".join(
        [
            "servo: {backend: dynamixel, port: /dev/ttyACM0, baud: 1e6, model: XM430-W350}",
            "model: {inertia: 0.01, damping: 0.01, coulomb: 0.1, delay: 0.001, torque_gain: 1}",
        ]
    )
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    assert load_config(str(file)).config.realtime.profile == "strict"
    relaxed = load_config(str(file), ["realtime.profile=off"]).config
    assert relaxed.realtime.profile == "off"
    assert relaxed.servo.baud == 1_000_000


@given(st.text(max_size=40))
def test_set_never_fails_but_with_a_message(text: str) -> None:
    try:
        load_config("simulated", [text, f"wall.stiffness={text}"])
    except UserError as error:
        assert "--set" in str(error) or "wall.stiffness" in str(error)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e6", 1e6),
        ("-1e-3", -1e-3),
        (".5", 0.5),
        ("off", "off"),
        ("1:30", "1:30"),
        ("null", None),
        ("", None),
        ("{value: 1, low: 0.5, high: 2e0}", {"value": 1, "low": 0.5, "high": 2.0}),
        ("'1e6'", "1e6"),
    ],
)
def test_words_and_numbers_mean_what_they_look_like(
    text: str, value: str | float | dict[str, float] | None
) -> None:
    data: dict[str, Any] = {"a": {}}
    assert apply_set(data, f"a.b={text}") == "a.b"
    assert data == {"a": {"b": value}}


# What is wrong


def test_all_problems_are_told_at_once_in_the_order_of_the_fields() -> None:
    found = problems(
        HARDWARE,
        "wall.stifness=1",
        "wall.side=abov",
        "loop.rate_hz=1e6",
        "loop.clock=simulated",
        "servo.baud=4e5",
        "servo.inertia=0.01",
        "model.inertia=null",
        "model.delay={value: 3, low: 1, high: 2}",
        "safety.max_loss=2",
        "nonsense",
    )
    starts = [
        "--set nonsense: wanted PATH=VALUE",
        "wall.stifness: unknown; did you mean wall.stiffness?",
        "loop.rate_hz: found 1000000.0, wanted a number from 50 to 10000 [Hz]",
        "wall.side: found 'abov', wanted one of above, below, both; did you mean above?",
        "servo.baud: found 400000.0, wanted one of 9600, 57600",
        "model.delay: found {'value': 3, 'low': 1, 'high': 2}, wanted a number from 0 to 0.1",
        "safety.max_loss: found 2, wanted a number above 0 and at most 1",
    ]
    assert len(found) == len(starts)
    for line, start in zip(found, starts, strict=True):
        assert line.startswith(start)
    rules = problems(HARDWARE, "loop.clock=simulated", "servo.inertia=0.01", "model.inertia=null")
    assert [line.partition(":")[0] for line in rules] == [
        "loop.clock",
        "servo.inertia",
        "model.inertia",
    ]


def test_every_field_refuses_what_is_beyond_all_bounds_and_what_is_no_number_or_name() -> None:
    for field, value in itertools.product(fields().values(), ("true", "[1]", ".nan", "{a: 1}")):
        if value != field.wanted.partition(" ")[0] and field.wanted != "a section":
            found = problems("simulated", f"{field.path}={value}")
            assert any(line.startswith(field.path) for line in found), (field, value)
    for field in fields().values():
        found = problems("simulated", f"{field.path}={'nonesuch' if field.choices else '-1e300'}")
        assert any(line.startswith(f"{field.path}: found") for line in found), field


def test_a_field_with_choices_names_its_default() -> None:
    for path, field in fields().items():
        section, key = path.split(".")
        default = sections()[section].model_fields[key].default
        known = (*field.choices, None) if field.wanted.endswith(" or null") else field.choices
        assert not field.choices or default in known, path


@pytest.mark.parametrize(
    ("change", "suggestion"),
    [
        ("wall.stifness=1", "did you mean wall.stiffness?"),
        ("wal.stiffness=1", "did you mean wall?"),
        ("stiffness=1", "did you mean wall.stiffness?"),
        ("servo.stiffness=1", "did you mean wall.stiffness?"),
        ("qqq=1", "`haptic-wall config` lists all"),
    ],
)
def test_an_unknown_name_comes_with_a_suggestion(change: str, suggestion: str) -> None:
    assert suggestion in only("simulated", change)


@pytest.mark.parametrize(
    ("preset", "changes", "blamed"),
    [
        (HARDWARE, ["loop.clock=simulated"], "loop.clock"),
        (HARDWARE, ["servo.hand=none"], "servo.hand"),
        (HARDWARE, ["servo.kick=0"], "servo.kick"),
        (HARDWARE, ["model.torque_gain=null"], "model.torque_gain"),
        (HARDWARE, ["servo.port=null"], "servo.port"),
        ("simulated", ["servo.inertia=null"], "servo.inertia"),
        ("emulated-ideal", ["servo.counts_per_rev=1024"], "servo.counts_per_rev"),
        ("emulated-ideal", ["servo.torque_constant=2"], "model.torque_gain"),
        (
            "emulated-ideal",
            ["loop.rate_hz=60", "servo.watchdog_s=0.02", "safety.max_silence_s=0.01"],
            "servo.watchdog_s",
        ),
        ("emulated-ideal", ["safety.max_silence_s=0.11"], "safety.max_silence_s"),
        ("xm430-w350", ["servo.watchdog_s=0.02"], "safety.max_silence_s"),
        ("simulated", ["loop.rate_hz=50", "safety.heartbeat_s=0.03"], "safety.heartbeat_s"),
        (HARDWARE, ["safety.engage=at-once"], "safety.engage"),
        (HARDWARE, ["safety.engage_torque=0.11"], "safety.engage_torque"),
        ("simulated", ["safety.travel=[1, -1]"], "safety.travel"),
    ],
)
def test_fields_that_do_not_go_together(preset: str, changes: list[str], blamed: str) -> None:
    assert only(preset, *changes).startswith(blamed)


def test_a_duplicate_key_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "twice.yaml"
    file.write_text("wall:\n  stiffness: 1\n  damping: 0\n  stiffness: 2\n")
    with pytest.raises(UserError, match="stiffness stands twice, in lines 2 and 4"):
        load_config(str(file))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- 1\n", "wanted sections"),
        ("wall: [\n", "line 2, column 1"),
        ("wall: !!python/object:os.system x\n", "could not determine a constructor"),
        ("{[1]: 2}\n", "unhashable"),
        ("wall:\n\tstiffness: 1\n", "line 2"),
        ("wall: \x00\n", "not readable as YAML"),
        ("wall: {}\n---\nwall: {}\n", "line 2, column 1: found another document"),
        (f"wall: {'[' * 1000}", "nested too deeply"),
        (f"wall: {{stiffness: {'9' * 5000}}}", "wall.stiffness: found inf, wanted a number"),
        ('"\\ud800": 1', "unable to parse raw data as a unicode string"),
    ],
)
def test_a_file_that_is_not_a_configuration(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    with pytest.raises(UserError, match=r"bad\.yaml") as refused:
        load_config(str(file))
    assert message in str(refused.value)


def test_what_may_never_end_is_not_a_configuration(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.symlink_to("/dev/zero")
    with pytest.raises(UserError, match=r"a\.yaml: cannot be read: it is a device, not a file"):
        load_config(str(path))


def test_aliases_are_refused_because_few_can_stand_for_billions(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("wall: &a {stiffness: 1}\nmodel: *a\n")
    with pytest.raises(UserError, match=r"line 2, column 8: found an alias"):
        load_config(str(path))


def test_a_file_that_is_too_long_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("#" * MOST_BYTES)
    only(path)
    path.write_text("#" * MOST_BYTES + "\n")
    with pytest.raises(UserError, match=f"it has more than {MOST_BYTES} bytes"):
        load_config(str(path))


def test_an_empty_file_lacks_only_what_has_no_default(tmp_path: Path) -> None:
    file = tmp_path / "empty.yaml"
    file.write_text("# nothing\n")
    assert only(file).startswith("servo.inertia: found nothing")


@given(st.text(st.sampled_from("[]{}&*ab:,\n -<!|>'\"#?%@`~1.\x1b\x00\ud800\u202e"), max_size=60))
def test_any_text_of_yaml_s_own_characters_is_read_or_refused_in_words(text: str) -> None:
    try:
        parse(text, "text")
    except UserError as error:
        assert str(error).startswith("text: ")


def test_the_manual_shows_the_messages_as_they_are() -> None:
    changes = ["wall.stifness=20", "guard.margin=1.2", "wall.side=abov"]
    manual = Path(__file__).parents[3] / "docs" / "reference" / "configuration.md"
    with pytest.raises(ConfigError) as refused:
        load_config("simulated", changes)
    assert f"haptic-wall: {refused.value}\n```" in manual.read_text(encoding="utf-8")
