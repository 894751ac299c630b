"""The tables against the vendor's own, which come with dynamixel-sdk, and against the manual."""

import itertools
import math
from pathlib import Path

import dynamixel_easy_sdk
import pytest

from hw.dynamixel.tables import MODELS, POSITION_UNIT, VELOCITY_UNIT, Register, model_by_number

VENDOR = Path(dynamixel_easy_sdk.__file__).parent / "control_table"
CURRENT_MODELS = [name for name, model in MODELS.items() if model.current_mode]


def vendor_numbers() -> dict[str, int]:
    """Model file -> model number."""
    lines = (VENDOR / "dynamixel.model").read_text(encoding="utf-8").splitlines()[1:]
    return {file: int(number) for number, file in (line.split("\t") for line in lines if line)}


def vendor_file(name: str) -> str:
    stem = name.lower().replace("-", "_")
    # Our X330 tables are the layout up to firmware 52.
    return f"{stem}_fw52.model" if MODELS[name].family == "X330" else f"{stem}.model"


def vendor_table(name: str) -> dict[str, tuple[int, int]]:
    """Register name (ours) -> address and size."""
    text = (VENDOR / vendor_file(name)).read_text(encoding="utf-8")
    rows = text.split("[control table]")[1].strip().splitlines()[1:]
    table = {}
    for row in rows:
        address, size, title = row.split("\t")
        key = title.lower().replace("(shadow)", "").replace(" ", "_")
        if key.startswith("indirect") and key.endswith(("read", "write")):
            continue  # the vendor's grouping of the same bytes
        table[key] = (int(address), int(size))
    return table


@pytest.mark.parametrize("name", MODELS)
def test_number_is_the_vendors(name):
    listed = f"{name.lower().replace('-', '_')}.model"
    assert vendor_numbers()[listed] == MODELS[name].number
    assert model_by_number(MODELS[name].number) is MODELS[name]


@pytest.mark.parametrize("name", MODELS)
def test_addresses_and_sizes_are_the_vendors(name):
    ours = {r.name: (r.address, r.size) for r in MODELS[name].registers.values()}
    vendor = vendor_table(name)
    assert len(vendor) > 40
    for register, place in vendor.items():
        assert ours[register] == place, register
    # Ours may know more, but only what the manual adds to the vendor's file.
    extra = {r for r in ours if not r.startswith("indirect")} - set(vendor)
    assert extra <= {"startup_configuration", "backup_ready", "pwm_slope"}


@pytest.mark.parametrize("name", MODELS)
def test_table_is_consistent(name):
    registers = list(MODELS[name].registers.values())
    for before, after in itertools.pairwise(registers):
        assert before.address + before.size <= after.address
    for register in registers:
        assert register.minimum <= register.default <= register.maximum, register
        assert register.decode(register.encode(register.default)) == register.default
        assert register.encode(register.maximum)
        assert register.encode(register.minimum)
        assert register.eeprom == (register.address < 64)


def test_xm430_w350_as_in_its_manual():
    table = MODELS["XM430-W350"].registers
    assert table["current_limit"] == Register("current_limit", 38, 2, True, 1193, 0, 1193)
    assert table["return_delay_time"].default == 250
    assert table["goal_current"].signed
    assert not table["present_position"].writable
    assert table["shutdown"].default == 0x34
    assert table["indirect_address_29"][:2] == ("indirect_address_29", 578)
    assert table["indirect_data_56"].address == 661


@pytest.mark.parametrize("name", MODELS)
def test_every_model_may_run_at_its_own_voltage(name):
    table = MODELS[name].registers
    volts = 10 * MODELS[name].voltage
    assert table["min_voltage_limit"].default < volts < table["max_voltage_limit"].default


@pytest.mark.parametrize("name", ["XC330-T181", "XC330-T288"])
def test_the_xc330_of_11_volts_as_in_their_manual(name):
    table = MODELS[name].registers
    assert table["max_voltage_limit"][4:] == (140, 55, 140)
    assert table["min_voltage_limit"][4:] == (55, 55, 140)


def test_block_from_the_tick_to_the_temperature_has_no_gaps():
    """One read of it serves the loop, so it must not run into an undefined address."""
    for name in CURRENT_MODELS:
        covered = {
            byte
            for r in MODELS[name].registers.values()
            for byte in range(r.address, r.address + r.size)
        }
        assert set(range(120, 147)) <= covered


def test_xl430_has_no_current_control():
    model = MODELS["XL430-W250"]
    assert not model.current_mode
    assert 0 not in model.modes
    assert "goal_current" not in model.registers
    assert "current_limit" not in model.registers
    assert model.registers["present_load"].address == 126


@pytest.mark.parametrize(
    ("name", "torque_per_ampere"),
    [("XM430-W350", 1.783), ("XM540-W270", 2.409), ("XL330-M288", 0.354), ("XH430-V350", 4.71)],
)
def test_torque_constant_is_the_stall_ratio(name, torque_per_ampere):
    assert MODELS[name].torque_constant == pytest.approx(torque_per_ampere, rel=2e-3)


@pytest.mark.parametrize("name", ["XD540-T270", "XD540-T150", "XW430-T333"])
def test_no_torque_constant_where_none_is_published(name):
    assert MODELS[name].torque_constant is None


def test_units():
    assert math.isclose(POSITION_UNIT * 4096, 2 * math.pi, rel_tol=1e-15)
    assert math.isclose(VELOCITY_UNIT, 0.0239808, rel_tol=1e-5)


def test_unknown_number_has_no_model():
    assert model_by_number(350) is None
