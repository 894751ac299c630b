"""Whatever is in a file, a terminal only shows it."""

import unicodedata

import pytest

from haptic_wall.controller.cli.main import main
from haptic_wall.controller.cli.options import as_json, put, say
from haptic_wall.controller.system.printable import in_line, printable

HOSTILE = "a\x1b[31m\x07\r\x9b\x7f\u202e\udcffb"


def test_no_control_character_is_left_and_all_else_is() -> None:
    for number in range(0x3000):
        character = chr(number)
        shown = printable(character)
        obeyed = unicodedata.category(character) == "Cc" and character not in "\t\n"
        assert not (obeyed and shown == character), number
        if unicodedata.category(character)[0] in "LMNPS" or character in " \t\n\u00a0":
            assert shown == character
    assert printable(HOSTILE) == r"a\x1b[31m\x07\r\x9b\x7f\u202e\udcffb"


def test_a_name_is_a_part_of_one_line_and_not_a_long_one() -> None:
    assert in_line("a\nended as planned") == r"a\nended as planned"
    assert in_line("x" * 300) == "x" * 200 + "..."


def test_all_that_is_said_or_answered_is_printable(capsys: pytest.CaptureFixture[str]) -> None:
    say(HOSTILE)
    put(HOSTILE)
    put(as_json({"name": HOSTILE}))
    captured = capsys.readouterr()
    assert captured.out + captured.err == printable(captured.out + captured.err)
    assert captured.out.endswith(
        '{\n  "name": "a\\u001b[31m\\u0007\\r\\u009b\\u007f\\u202e\\udcffb"\n}\n'
    )


@pytest.mark.parametrize(
    "arguments",
    [
        ["log", HOSTILE],
        ["detect", HOSTILE],
        ["config", HOSTILE],
        [HOSTILE],
        ["log", "--" + HOSTILE],
    ],
)
def test_a_name_on_the_command_line_is_told_as_escapes(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert told == printable(told)
    assert r"\x07\r\x9b" in told
