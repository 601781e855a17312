"""PDO configuration rules, transmission types, and the motion that goes through PDOs against the exact plant."""

import math
import struct
import time

import numpy as np
import pytest

from hapticd.config import load_config
from hapticd.plant import kernel
from sim_hw import log
from tests.sim_hw.canopen.master import ENABLED, FAULT, drive_state

NOT_VALID = 1 << 31
AMPLIFIER_S = 0.001
"""More than the amplifier's lag T_A, 74 µs."""


def test_mapping_follows_the_rules_of_the_standard(start_drive):
    _, master = start_drive()
    master.write(0x1800, 1, 0x181, 4)
    assert master.refused(0x1A00, 0, 0, 1) == 0x06010000  # the PDO is valid
    master.write(0x1800, 1, 0x181 | NOT_VALID, 4)
    assert master.refused(0x1A00, 1, 0x60640020, 4) == 0x06010000  # its count is not 0
    master.write(0x1A00, 0, 0, 1)
    assert master.refused(0x1A00, 1, 0x12340020, 4) == 0x06020000  # no such object
    assert master.refused(0x1A00, 1, 0x60640010, 4) == 0x06040041  # another length
    assert master.refused(0x1A00, 1, 0x10080020, 4) == 0x06040041  # cannot be mapped
    for sub in (1, 2, 3):
        master.write(0x1A00, sub, 0x60640020, 4)
    assert master.refused(0x1A00, 0, 3, 1) == 0x06040042  # 96 bits
    master.write(0x1A00, 0, 2, 1)
    for kind in (241, 252, 253):
        assert master.refused(0x1800, 2, kind, 1) == 0x06090030
    assert master.refused(0x1800, 1, 0x80, 4) == 0x06090030  # SYNC's own identifier
    master.write(0x1400, 1, 0x201 | NOT_VALID, 4)
    master.write(0x1600, 0, 0, 1)
    assert master.refused(0x1600, 1, 0x60410010, 4) == 0x06040041  # an input cannot be received


def test_synchronous_types_count_syncs_and_type_0_waits_for_a_change(start_drive):
    _, master = start_drive()
    master.map_pdo(0x1800, 0x1A00, 0x181, 3, [0x60410010])
    master.map_pdo(0x1801, 0x1A01, 0x281, 0, [0x60410010])
    master.nmt(1)
    for _ in range(9):
        master.send(0x80)
    identifiers = [frame[0] for frame in master.settle()]
    assert identifiers.count(0x181) == 3
    assert identifiers.count(0x281) == 1
    master.control(0x06)
    master.send(0x80)
    assert struct.unpack("<H", master.wait_for(0x281))[0] & 0x6F == 0x21


def test_event_driven_tpdo_comes_with_a_new_statusword_and_by_its_timer(start_drive):
    _, master = start_drive()
    master.map_pdo(0x1800, 0x1A00, 0x181, 255, [0x60410010])
    master.write(0x1800, 5, 20, 2)
    master.nmt(1)
    assert drive_state(struct.unpack("<H", master.wait_for(0x181))[0]) == 0x40
    master.send(0x601, bytes.fromhex("2B 40 60 00 06 00 00 00"))
    assert drive_state(struct.unpack("<H", master.wait_for(0x181))[0]) == 0x21
    for _ in range(3):
        assert drive_state(struct.unpack("<H", master.wait_for(0x181))[0]) == 0x21


def test_synchronous_rpdo_waits_for_sync_and_a_short_one_is_refused(start_drive):
    drive, master = start_drive()
    master.bring_up()
    master.nmt(128)
    master.map_pdo(0x1400, 0x1600, 0x201, 1, [0x60400010, 0x60710010])
    master.nmt(1)
    master.command(0x0F, 300)
    assert master.read(0x6071) == 0
    master.sync()
    assert master.read(0x6071) == 300
    master.send(0x201, b"\x0f\x00")
    assert master.wait_for(0x81)[:2] == (0x8210).to_bytes(2, "little")
    rows = drive.stop()
    assert rows["code"][rows["event"] == log.EMCY].tolist() == [0x8210]


@pytest.mark.parametrize("mode", [10, 0])
def test_motion_is_the_exact_plants(start_drive, mode):
    """Replays the commands of the drive's log through the plant: every sampled position must come out again."""
    drive, master = start_drive("--no-cst") if mode == 0 else start_drive()
    config = load_config(None)
    master.bring_up(mode=mode)
    rng = np.random.default_rng(3)
    samples = []
    targets = rng.integers(-100, 100, 200).tolist()
    for target in targets:
        status, counts, actual = master.sync()
        assert drive_state(status) == ENABLED
        samples.append((counts, actual))
        master.command(0x0F, target)
    master.settle()
    rows = drive.stop()
    sampled = rows[rows["event"] == log.SAMPLE]
    commanded = rows[rows["event"] == log.COMMAND][-len(targets) :]
    unit = 58e-6 / 0.0292 if mode else 0.01
    np.testing.assert_allclose(commanded["command_A"], np.array(targets) * unit, rtol=1e-12)

    f = kernel.init_plant(config)
    f[kernel.DAC_STEP] = 0.0
    i = f.view(np.int64)
    i[kernel.TIME_NS] = rows["time_ns"][0]
    events = [(row["time_ns"], None) for row in sampled] + [(row["time_ns"], row["command_A"]) for row in commanded]
    positions, currents = [], []
    for time_ns, current in sorted(events, key=lambda event: (event[0], event[1] is not None)):
        kernel.plant_advance(f, i, time_ns, 0.0)
        if current is None:
            positions.append(f[kernel.POSITION])
            currents.append(f[kernel.CURRENT])
        else:
            kernel.plant_command(f, i, time_ns, 0.0, current)
    np.testing.assert_allclose(sampled["position"], positions, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(sampled["applied_A"], currents, atol=1e-15)
    assert [counts for counts, _ in samples] == [math.floor(x / config.raw_resolution) for x in positions]
    assert [actual for _, actual in samples] == [round(current / unit) for current in currents]


def test_power_up_slope_is_a_trap(start_drive):
    """1000 ‰/s: 300 ‰ take 300 ms, in steps of the drive's cycle, until the slope is switched off."""
    drive, master = start_drive()
    master.bring_up(slope=1000)
    master.command(0x0F, 300)
    master.settle()
    time.sleep(0.4)
    master.write(0x6087, 0, 0, 4)
    master.command(0x0F, -300)
    master.settle()
    rows = drive.stop()
    start, end = rows["time_ns"][rows["event"] == log.COMMAND][-2:]
    applied = rows[(rows["event"] == log.APPLIED) & (rows["time_ns"] < end)]
    unit = 58e-6 / 0.0292
    assert applied["applied_A"][-1] == pytest.approx(300 * unit)
    assert (applied["time_ns"][-1] - start) * 1e-9 == pytest.approx(0.3, abs=2e-4)
    slopes = np.diff(applied["applied_A"]) / np.diff(applied["time_ns"]) * 1e9
    np.testing.assert_allclose(slopes[:-1], 1000 * unit, rtol=1e-4)
    last = rows[(rows["event"] == log.APPLIED) & (rows["time_ns"] > end)]
    assert last["applied_A"][0] == pytest.approx(-300 * unit)
    assert last["time_ns"][0] - end < 80_000  # the amplifier's lag alone


def test_limits_hold_and_are_shown(start_drive):
    _, master = start_drive()
    master.bring_up()
    master.write(0x2110, 0, 50, 2)
    master.command(0x0F, 1000)
    master.settle()
    time.sleep(AMPLIFIER_S)
    assert master.sync()[0] & 1 << 11  # internal limit active
    assert master.read(0x221C) == 50
    master.write(0x6072, 0, 100, 2)
    time.sleep(AMPLIFIER_S)
    assert master.read(0x6077) == 100
    assert not master.sync()[0] & 1 << 11


def test_current_folds_back_to_continuous_after_the_peak_time(start_drive):
    drive, master = start_drive(plant={"plant": {"viscous": 1.0}})
    master.bring_up()
    master.write(0x2112, 0, 50, 2)
    master.command(0x0F, 2014)  # 4 A of 6 A peak, 2 A continuous: (36 − 4)·0.05/(16 − 4) s = 133 ms
    master.settle()
    time.sleep(0.3)
    assert master.read(0x221C) == 200
    rows = drive.stop()
    applied = rows[rows["event"] == log.APPLIED]
    first, folded = applied[0], applied[1]
    assert folded["applied_A"] == pytest.approx(2.0)
    assert (folded["time_ns"] - first["time_ns"]) * 1e-9 == pytest.approx(0.1333, abs=1.5e-3)


def test_rpdo_that_stays_out_past_its_deadline_ends_the_current(start_drive):
    drive, master = start_drive()
    master.bring_up(enable=False)
    master.write(0x1400, 5, 100, 2)
    master.enable()
    before_ns = time.monotonic_ns()
    master.command(0x0F, 300)
    assert master.wait_for(0x81)[:2] == (0x8250).to_bytes(2, "little")
    master.wait_state(FAULT)
    rows = drive.stop()
    command = rows[rows["event"] == log.COMMAND][-1]
    disabled = rows[rows["event"] == log.DISABLE][0]
    assert command["time_ns"] > before_ns
    assert disabled["time_ns"] - command["time_ns"] == 100_000_000
    assert rows["applied_A"].max() > 0.5
    assert rows["applied_A"][-1] == 0.0


def test_a_deadline_of_0_or_another_nmt_state_watches_nothing(start_drive):
    _, master = start_drive()
    master.bring_up()
    master.write(0x1400, 5, 50, 2)
    master.command(0x0F, 0)
    master.write(0x1400, 5, 0, 2)
    time.sleep(0.1)
    assert master.state() == ENABLED
    master.write(0x1400, 5, 50, 2)
    master.command(0x0F, 0)
    master.nmt(128)
    time.sleep(0.1)
    assert master.state() == ENABLED
