"""``init`` writes a preset with what else can be set, and keeps what is there."""

import re
from pathlib import Path

import pytest

from haptic_wall.controller.cli.init import commented
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import load_config, preset_names, preset_text
from tests.support.program import Cli


@pytest.mark.parametrize("preset", preset_names())
def test_the_file_is_the_preset(cli: Cli, tmp_path: Path, preset: str) -> None:
    file = tmp_path / "mine.yaml"
    assert cli("init", file, "--from", preset).status == 0
    assert load_config(str(file)).config == load_config(preset).config


@pytest.mark.parametrize("preset", preset_names())
def test_what_is_commented_out_can_be_set(tmp_path: Path, preset: str) -> None:
    """With every # taken away all values of this kind of servo are set, to their defaults."""
    file = tmp_path / "mine.yaml"
    text = re.sub(r"^# (\w+:)$", r"\1", commented(preset), flags=re.M)
    file.write_text(re.sub(r"^  # (\w+: )", r"  \1", text, flags=re.M))
    mine, plain = load_config(str(file)), load_config(preset)
    assert mine.config == plain.config
    kind = plain.config.servo.kind
    given = {path for path in mine.given if not path.startswith("axes.")}
    assert given == {f.path for f in fields().values() if kind in f.used_by}


def test_a_file_that_is_there_is_kept(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    assert cli("init", file).status == 0
    held = file.read_text() + "# mine\n"
    file.write_text(held)
    assert "--force" in cli.refused("init", file)
    assert file.read_text() == held
    assert cli("init", file, "--force").status == 0
    assert file.read_text() != held


@pytest.mark.parametrize("preset", ["xm430-w350", "emulated-arm"])
def test_a_file_has_an_axis_for_each_id(cli: Cli, tmp_path: Path, preset: str) -> None:
    file = tmp_path / "arm.yaml"
    assert cli("init", file, "--axes", "3,1", "--from", preset).status == 0
    config = load_config(str(file)).config
    assert {name: one.servo.id for name, one in config.each.items()} == {"axis_3": 3, "axis_1": 1}
    assert (config.loop.rate_hz, config.wall.law, config.wall.position) == (500.0, "none", 0.0)


def test_a_preset_that_the_axes_do_not_fit_is_refused(cli: Cli, tmp_path: Path) -> None:
    told = cli.refused("init", tmp_path / "arm.yaml", "--axes", "1", "--from", "emulated-arm")
    assert "wall.low: found nothing" in told and "give --urdf" in told


def test_the_pages_that_a_preset_names_are_there() -> None:
    root = Path(__file__).parents[2]
    texts = [preset_text(each) for each in preset_names()]
    named = {page for text in texts for page in re.findall(r"docs/\S+?\.md", text)}
    assert named and all((root / page).is_file() for page in named)


ROBOT = """<robot name="arm">
<joint name="Shoulder Pan" type="revolute"><limit lower="-1.9" upper="1.9" effort="1"/></joint>
<joint name="wheel" type="continuous"/>
<joint name="2nd" type="revolute"><limit upper="1.6"/></joint>
<joint name="jaw" type="revolute"><limit lower="-1" upper="1"/><mimic joint="2nd"/></joint>
<joint name="slide" type="prismatic"><limit lower="-1" upper="1"/></joint>
</robot>"""


def test_the_stops_of_a_file_are_the_limits_of_a_robot(cli: Cli, tmp_path: Path) -> None:
    file, robot = tmp_path / "arm.yaml", tmp_path / "arm.urdf"
    robot.write_text(ROBOT)
    ask = ("init", file, "--urdf", robot, "--from", "xm430-w350", "--force")
    assert cli(*ask, "--margin", 0.2).status == 0
    axes = load_config(str(file)).config.each
    ends = {name: (one.servo.id, one.wall.low, one.wall.high) for name, one in axes.items()}
    # a joint without stops keeps its place among the ids, or the stops would be another servo's
    assert ends == {
        "shoulder_pan": (1, -1.7, 1.7),
        "wheel": (2, None, None),
        "joint_2nd": (3, 0.2, 1.4),
        "slide": (4, None, None),
    }
    assert [one.wall.law for one in axes.values()] == ["stops", "none", "stops", "none"]
    assert {axes[name].wall.position for name in ("shoulder_pan", "joint_2nd")} == {0.0}
    assert "wanted 4, one for each of shoulder_pan, wheel," in cli.refused(*ask, "--axes", 7)
    assert "half the range of the joint 2nd" in cli.refused(*ask, "--margin", 0.8)


def test_joints_with_one_name_in_an_axis_letters_stay_apart(cli: Cli, tmp_path: Path) -> None:
    file, robot = tmp_path / "arm.yaml", tmp_path / "arm.urdf"
    joints = ROBOT.replace("Shoulder Pan", "joint_2").replace("2nd", "Joint-2")
    robot.write_text(joints)
    assert cli("init", file, "--urdf", robot, "--from", "xm430-w350").status == 0
    axes = load_config(str(file)).config.each
    highs = {name: one.wall.high for name, one in axes.items() if one.wall.high}
    assert highs == {"joint_2": 1.8, "joint_3": 1.5}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot>", "no XML"),
        ("<robot/>", "0 joints that move"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><robot>&b;</robot>', "a document type"),
        (ROBOT.replace("1.6", "much"), "limits of the joint 2nd that are no numbers"),
        (ROBOT.replace("1.6", "nan"), "limits of the joint 2nd that are no range"),
        (ROBOT.replace("1.6", "-2"), "limits of the joint 2nd that are no range"),
        (ROBOT.replace("1.6", "0.2"), "half the range of the joint 2nd"),
        ("\ud800", "no XML"),
    ],
)
def test_a_wrong_robot_is_refused(cli: Cli, tmp_path: Path, text: str, said: str) -> None:
    robot = tmp_path / "arm.urdf"
    robot.write_bytes(text.encode("utf-8", "surrogatepass"))
    assert said in cli.refused("init", tmp_path / "arm.yaml", "--urdf", robot)
    assert not (tmp_path / "arm.yaml").exists()
