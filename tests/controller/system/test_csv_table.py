"""CSVs as spreadsheets of other languages write them are refused with their own name."""

from pathlib import Path

import pytest

from haptic_wall.controller.cli.main import main

GERMAN = "time_s;position_rad;torque_nm\n0,000;0,5;0,1\n0,001;0,6;0,1\n"
FILES = {
    "semicolons and decimal commas": (
        GERMAN,
        "found time_s;position_rad",
    ),
    "a line sep": (f"sep=;\n{GERMAN}", "found sep=;"),
    "tabs": (GERMAN.replace(";", "\t"), "found time_s"),
    "only decimal commas": (
        'time_s,position_rad,torque_nm\n"0,001","0,5","0,1"\n',
        "set the spreadsheet to English",
    ),
}


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize(
    ("command", "place"),
    [
        (["identify", "--record", "{file}"], "--record"),
        (["detect", "{file}"], "LOG"),
        (["config", "simulated", "--set=wall.law=profile", "--set=wall.profile={file}"], "wall."),
    ],
    ids=["identify", "detect", "profile"],
)
def test_each_reader_of_csvs_names_it(
    kind: str,
    command: list[str],
    place: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text, found = FILES[kind]
    file = tmp_path / "german.csv"
    file.write_text(text)
    assert main([word.format(file=file) for word in command]) == 2
    said = capsys.readouterr().err
    assert place in said
    assert found.removeprefix("found ") in said
    assert "set the spreadsheet to English" in said
