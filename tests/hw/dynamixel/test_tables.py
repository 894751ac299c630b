"""The tables against the vendor's own, which come with dynamixel-sdk, and against the manual."""

from pathlib import Path

import dynamixel_easy_sdk
import pytest

from haptic_wall.hw.dynamixel.tables import MODELS, NO_CURRENT_MODE, REGISTERS

VENDOR = Path(dynamixel_easy_sdk.__file__).parent / "control_table"
UNLISTED = {"XW430-T200": 1280}
"""Models that the vendor does not list, with the number on their page; it may ship their table"""


def vendor_numbers() -> dict[str, int]:
    """Model file -> model number."""
    lines = (VENDOR / "dynamixel.model").read_text(encoding="utf-8").splitlines()[1:]
    return {file: int(number) for number, file in (line.split("\t") for line in lines if line)}


def path_of(file: str) -> Path:
    """Path of a vendor's file, which is named after its model."""
    return VENDOR / file.lower().replace("-", "_")


X330 = [name for name, model in MODELS.items() if model.family == "X330"]
VENDOR_TABLES = [(name, f"{name}.model", MODELS[name].fast_sync_read_firmware) for name in MODELS]
VENDOR_TABLES = [row for row in VENDOR_TABLES if row[0] not in X330]
VENDOR_TABLES += [(name, f"{name}_fw52.model", 46) for name in X330]
VENDOR_TABLES += [(name, f"{name}_fw52.model", 52) for name in X330]
VENDOR_TABLES += [(name, f"{name}.model", 53) for name in X330]
VENDOR_TABLES = [row for row in VENDOR_TABLES if row[0] not in UNLISTED or path_of(row[1]).exists()]
"""Model, the vendor's file, and a firmware it holds for"""


def vendor_table(file: str) -> dict[str, tuple[int, int]]:
    """Register name (ours) -> address and size."""
    text = path_of(file).read_text(encoding="utf-8")
    rows = text.split("[control table]")[1].strip().splitlines()[1:]
    table = {}
    for row in rows:
        address, size, title = row.split("\t")
        key = title.lower().replace("(shadow)", "").replace(" ", "_")
        if key.startswith("indirect"):
            continue  # not in ours
        table[key] = (int(address), int(size))
    return table


def test_every_x_series_model_of_the_vendor_is_known_by_its_number() -> None:
    """Names of the X series begin with X or 2X; the XL320 is of an older make."""
    listed = {
        number: file.removesuffix(".model")
        for file, number in vendor_numbers().items()
        if file.lstrip("2").startswith("x") and file != "xl320.model"
    }
    names = {model.number: name for name, model in MODELS.items()} | NO_CURRENT_MODE
    ours = {number: path_of(name).name for number, name in names.items()}
    unlisted = {number: path_of(name).name for name, number in UNLISTED.items()}
    assert dict(ours.items() - listed.items()) == unlisted
    assert listed.items() <= ours.items()


@pytest.mark.parametrize(("name", "file", "firmware"), VENDOR_TABLES)
def test_addresses_and_sizes_are_the_vendors(name: str, file: str, firmware: int) -> None:
    table = MODELS[name].registers_at(firmware)
    ours = {r.name: (r.address, r.size) for r in table.values()}
    vendor = vendor_table(file)
    assert len(vendor) > 40
    for register, place in vendor.items():
        assert ours[register] == place, register
    # Ours may know more, but only what the manual adds to the vendor's file.
    extra = set(ours) - set(vendor)
    assert extra <= {"startup_configuration", "backup_ready", "pwm_slope"}


# From the manual's pages: current limit, velocity limit, voltages [0.1 V], temperature, shutdown,
# drive mode's largest value.
PAGES = {
    "XL330-M077": (1750, 1620, 35, 70, 70, 53, 13),
    "XL330-M288": (1750, 445, 35, 70, 70, 53, 13),
    "XC330-M181": (2352, 545, 35, 70, 70, 52, 13),
    "XC330-M288": (2352, 350, 35, 70, 70, 52, 13),
    "XC330-T181": (910, 510, 55, 140, 70, 52, 13),
    "XC330-T288": (910, 320, 55, 140, 70, 52, 13),
    "XM430-W210": (1193, 330, 95, 160, 80, 52, 13),
    "XM430-W350": (1193, 200, 95, 160, 80, 52, 13),
    "XH430-W210": (648, 210, 95, 160, 80, 52, 13),
    "XH430-W350": (648, 130, 95, 160, 80, 52, 13),
    "XH430-V210": (689, 230, 110, 300, 80, 52, 13),
    "XH430-V350": (689, 135, 110, 300, 80, 52, 13),
    "XD430-T210": (648, 210, 95, 160, 80, 52, 13),
    "XD430-T350": (648, 130, 95, 160, 80, 52, 13),
    "XM540-W150": (2047, 230, 95, 160, 80, 52, 15),
    "XM540-W270": (2047, 128, 95, 160, 80, 52, 15),
    "XH540-W150": (2047, 300, 95, 160, 80, 52, 15),
    "XH540-W270": (2047, 167, 95, 160, 80, 52, 15),
    "XH540-V150": (1188, 230, 110, 300, 80, 52, 15),
    "XH540-V270": (1188, 128, 110, 300, 80, 52, 15),
    "XD540-T150": (2047, 300, 95, 160, 80, 52, 15),
    "XD540-T270": (2047, 167, 95, 160, 80, 52, 15),
    "XW430-T200": (2047, 235, 95, 160, 80, 52, 13),
    "XW430-T333": (2047, 139, 95, 160, 80, 52, 13),
    "XW540-T140": (2047, 304, 95, 160, 80, 52, 13),
    "XW540-T260": (2047, 167, 95, 160, 80, 52, 13),
    "XW540-H260": (1188, 145, 110, 300, 80, 52, 13),
}


@pytest.mark.parametrize("name", MODELS)
def test_factory_settings_and_limits_are_those_of_the_models_own_page(name: str) -> None:
    table = MODELS[name].registers
    found = (
        table["current_limit"].default,
        table["velocity_limit"].default,
        table["min_voltage_limit"].default,
        table["max_voltage_limit"].default,
        table["temperature_limit"].default,
        table["shutdown"].default,
        table["drive_mode"].maximum,
    )
    assert found == PAGES[name]
    assert table["velocity_limit"].maximum == (2047 if name in X330 else 1023)
    assert table["baud_rate"].maximum == (6 if name in X330 else 7)


@pytest.mark.parametrize(
    ("name", "torque_per_ampere"),
    [("XM430-W350", 1.783), ("XM540-W270", 2.409), ("XL330-M288", 0.354), ("XH430-V350", 4.71)],
)
def test_torque_constant_is_the_stall_ratio(name: str, torque_per_ampere: float) -> None:
    assert MODELS[name].torque_constant == pytest.approx(torque_per_ampere, rel=2e-3)


@pytest.mark.parametrize(
    "name", ["torque_enable", "goal_current", "bus_watchdog", "hardware_error_status"]
)
def test_what_is_used_without_asking_for_the_model_is_the_same_in_all(name: str) -> None:
    found = {
        (model.registers[name].address, model.registers[name].size)
        for model in MODELS.values()
        if name in model.registers
    }
    assert found == {(REGISTERS[name].address, REGISTERS[name].size)}
