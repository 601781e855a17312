"""Every kind of fault that a script can inject into the drive, seen from the bus and in the drive's own log."""

import struct
import time

import pytest

from sim_hw import kinds, log
from tests.polling import wait_until
from tests.sim_hw.canopen.master import DISABLED, ENABLED, ERROR, READ_DEVICE_TYPE, Master, drive_state


def _frame_fault(kind, frames, **more):
    return {"faults": [{"kind": kind, "at_s": 0, "from": "enabled", "frames": frames, **more}]}


def _injected(drive):
    rows = drive.stop()
    return rows["code"][rows["event"] == log.FAULT_INJECTED].tolist()


def test_dropped_syncs_and_tpdos_bring_no_tpdo(start_drive):
    for frames in ("sync", "tpdo"):
        drive, master = start_drive(script=_frame_fault("drop", frames, count=2))
        master.bring_up()
        for _ in range(2):
            assert master.unanswered(0x80, 0x181)
        assert drive_state(master.sync()[0]) == ENABLED
        rows = drive.stop()
        assert (rows["event"] == log.SAMPLE).sum() == (1 if frames == "sync" else 3)


def test_dropped_command_is_never_applied(start_drive):
    drive, master = start_drive(script=_frame_fault("drop", "rpdo", count=1))
    master.bring_up()
    master.command(0x0F, 300)
    assert master.read(0x6071) == 0
    assert _injected(drive) == [kinds.DROP]


def test_corrupt_frames_are_a_byte_short(start_drive):
    drive, master = start_drive(script=_frame_fault("corrupt", "tpdo", count=1))
    master.bring_up()
    master.send(0x80)
    assert len(master.wait_for(0x181)) == 7
    assert len(struct.pack("<Hih", *master.sync())) == 8
    assert _injected(drive) == [kinds.CORRUPT]


def test_corrupt_command_is_refused_with_an_emergency(start_drive):
    drive, master = start_drive(script=_frame_fault("corrupt", "rpdo", count=1))
    master.bring_up()
    master.command(0x0F, 300)
    assert master.wait_for(0x81)[:2] == (0x8210).to_bytes(2, "little")
    assert master.read(0x6071) == 0
    assert _injected(drive) == [kinds.CORRUPT]


def test_corrupt_sync_is_refused_with_an_emergency(start_drive):
    _, master = start_drive(script=_frame_fault("corrupt", "sync", count=1))
    master.bring_up()
    master.send(0x80)
    assert master.wait_for(0x81)[:2] == (0x8240).to_bytes(2, "little")


def test_duplicates_come_twice(start_drive):
    drive, master = start_drive(script=_frame_fault("duplicate", "tpdo", count=1))
    master.bring_up()
    master.send(0x80)
    assert [frame[0] for frame in master.settle()] == [0x181, 0x181]
    assert _injected(drive) == [kinds.DUPLICATE]


def test_delayed_frames_come_late(start_drive):
    _, master = start_drive(script=_frame_fault("delay", "tpdo", count=1, delay_s=0.1))
    master.bring_up()
    before = time.monotonic()
    master.sync()
    assert time.monotonic() - before >= 0.1


def test_delayed_command_is_applied_late(start_drive):
    drive, master = start_drive(script=_frame_fault("delay", "rpdo", count=1, delay_s=0.05))
    master.bring_up()
    master.command(0x0F, 300)
    wait_until(lambda: master.read(0x6071) == 300, "the late command")
    rows = drive.stop()
    injected = rows[rows["event"] == log.FAULT_INJECTED][0]
    command = rows[rows["event"] == log.COMMAND][-1]
    assert command["command_A"] > 0.5
    assert command["time_ns"] - injected["time_ns"] >= 50_000_000


def test_reordered_commands_change_places(start_drive):
    drive, master = start_drive(script=_frame_fault("reorder", "rpdo", count=1))
    master.bring_up()
    master.command(0x0F, 100)
    master.command(0x0F, 200)
    master.settle()
    rows = drive.stop()
    commanded = rows["command_A"][rows["event"] == log.COMMAND][-2:]
    assert commanded[0] == pytest.approx(2 * commanded[1])


def test_sdo_replies_can_be_dropped(start_drive):
    _, master = start_drive(script={"faults": [{"kind": "drop", "at_s": 0, "frames": "reply", "count": 1}]})
    assert master.unanswered(0x601, 0x581, READ_DEVICE_TYPE)
    assert master.read(0x1000) == 0x00020192


def test_frozen_counter_and_glitch_and_wrap(start_drive):
    script = {
        "start": {"counts_offset": 2**31 - 5},
        "faults": [
            {"kind": "encoder_glitch", "at_s": 0, "from": "enabled", "counts": 1000, "count": 1},
            {"kind": "freeze_counter", "at_s": 0.6, "from": "enabled", "duration_s": 0.3},
        ],
    }
    drive, master = start_drive(script=script)
    master.bring_up()
    glitched = master.sync()[1]
    after = master.sync()[1]
    assert glitched == 2**31 - 5 + 1000 - 2**32
    assert after == 2**31 - 5
    master.command(0x0F, 200)
    counts = []
    end = time.monotonic() + 1.2
    while time.monotonic() < end:
        counts.append(master.sync()[1])
        time.sleep(0.001)
    rows = drive.stop()
    sampled = rows[rows["event"] == log.SAMPLE][2:]
    start = rows["time_ns"][(rows["event"] == log.FAULT_INJECTED) & (rows["code"] == kinds.FREEZE_COUNTER)][0]
    frozen = (sampled["time_ns"] > start) & (sampled["time_ns"] < start + 300_000_000)
    shown = {count for count, still in zip(counts, frozen, strict=True) if still}
    assert len(shown) == 1
    assert min(counts) < 0 < max(counts) or max(counts) < 0  # it went through the wrap
    true = (sampled["counts"][~frozen] + 2**31) % 2**32 - 2**31
    assert [count for count, still in zip(counts, frozen, strict=True) if not still] == true.tolist()


def test_unplugged_socket_is_gone_and_comes_back(start_drive):
    script = {"faults": [{"kind": "unplug", "at_s": 0.1, "from": "enabled", "duration_s": 1.0}]}
    drive, master = start_drive(script=script)
    master.bring_up(enable=False)
    master.enable()
    master.wait_for_hang_up()
    assert not drive.socket.exists()
    again = Master(drive.socket)
    assert drive_state(again.sync()[0]) == ENABLED
    again.close()


def test_silent_drive_still_listens(start_drive):
    script = {"faults": [{"kind": "silent", "at_s": 0, "from": "enabled", "duration_s": 1.0}]}
    drive, master = start_drive(script=script)
    master.bring_up(enable=False)
    master.enable()
    master.command(0x0F, 300)
    with pytest.raises(TimeoutError):
        master.sync(0.1)
    time.sleep(1.0)
    assert drive_state(master.sync()[0]) == ENABLED
    assert drive.stop()["applied_A"].max() > 0.5


def test_bus_off_sends_an_error_frame_and_then_nothing_passes(start_drive):
    script = {"faults": [{"kind": "bus_off", "at_s": 0.05, "from": "enabled"}]}
    drive, master = start_drive(script=script)
    master.bring_up(enable=False)
    master.write(0x100C, 0, 250, 2)
    master.write(0x100D, 0, 4, 1)
    master.guard()
    master.enable()
    master.command(0x0F, 300)
    assert len(master.wait_for(ERROR | 0x40)) == 8
    master.command(0x0F, 0)
    with pytest.raises(TimeoutError):
        master.sync(1.1)  # longer than the life time
    rows = drive.stop()
    assert rows["code"][rows["event"] == log.EMCY].tolist() == [0x8130]
    assert rows["applied_A"][-1] == 0.0


def test_drive_that_leaves_operation_enabled(start_drive):
    script = {"faults": [{"kind": "leave_operation_enabled", "at_s": 0.05, "from": "enabled"}]}
    drive, master = start_drive(script=script)
    master.bring_up(enable=False)
    master.enable()
    master.command(0x0F, 300)
    while drive_state(master.sync()[0]) == ENABLED:
        time.sleep(0.001)
    assert drive_state(master.sync()[0]) == DISABLED
    rows = drive.stop()
    disabled = rows[rows["event"] == log.DISABLE][0]
    injected = rows[rows["event"] == log.FAULT_INJECTED][0]
    enabled = rows[rows["event"] == log.ENABLE][0]
    assert disabled["time_ns"] == injected["time_ns"] == enabled["time_ns"] + 50_000_000
    assert rows["applied_A"][-1] == 0.0
    assert log.EMCY not in rows["event"]


def test_rebooting_node_loses_its_state(start_drive):
    script = {"faults": [{"kind": "reboot", "at_s": 0.1, "from": "enabled", "off_s": 0.2}]}
    drive, master = start_drive(script=script)
    master.bring_up(enable=False)
    master.enable()
    master.command(0x0F, 300)
    assert master.wait_for(0x701) == b"\0"
    assert master.read(0x6087) == 1000
    assert master.state() == DISABLED
    assert master.unanswered(0x80, 0x181)
    rows = drive.stop()
    reboot = rows[rows["event"] == log.REBOOT][0]
    boot = rows[(rows["event"] == log.STATE) & (rows["detail"] == 0)][-1]
    assert boot["time_ns"] - reboot["time_ns"] == 200_000_000


def test_hand_pushes_the_shaft(start_drive):
    script = {"hand": [{"at_s": 0.0, "force": 0.004}, {"at_s": 0.2, "force": 0}]}
    drive, master = start_drive(script=script)
    master.bring_up(enable=False)
    time.sleep(0.3)
    assert master.sync()[1] > 0
    rows = drive.stop()
    assert (rows["event"] == log.HAND).sum() == 2


@pytest.mark.parametrize(("factor", "current", "told"), [(-1, 0.0, -300), (0, 0.0, 0), (0, 3.0, 1510), (1, 0.1, 350)])
def test_measured_current_is_not_the_true_one(start_drive, factor, current, told):
    lie = {"kind": "measured_current", "at_s": 0.3, "from": "enabled", "factor": factor, "current": current}
    drive, master = start_drive(script={"faults": [lie]})
    master.bring_up(enable=False)
    master.enable()
    master.command(0x0F, 300)
    wait_until(lambda: abs(master.sync()[2] - 300) <= 1, "the current commanded")
    wait_until(lambda: abs(master.sync()[2] - told) <= 1, "the current told")
    master.command(0x0F, 300)
    assert abs(master.read(0x6077, signed=True) - told) <= 1
    rows = drive.stop()
    assert rows["applied_A"][-1] == pytest.approx(0.6, rel=0.02)  # 300 ‰ of 58 mN m at 29.2 mN m/A
    assert rows["code"][rows["event"] == log.FAULT_INJECTED].tolist() == [kinds.MEASURED_CURRENT]


def test_second_node_answers_every_sync_too(start_drive):
    fault = {"kind": "second_node", "at_s": 0, "from": "enabled", "counts": 400, "count": 2}
    drive, master = start_drive(script={"faults": [fault]})
    master.bring_up()
    for answers in (2, 2, 1):
        master.send(0x80)
        told = [struct.unpack("<Hih", data) for cob_id, data in master.settle() if cob_id == 0x181]
        assert len(told) == answers
        assert all(second[1] == told[0][1] + 400 for second in told[1:])
    assert _injected(drive) == [kinds.SECOND_NODE]


def test_foreign_sdo_writes_and_is_answered_to_all(start_drive):
    fault = {"kind": "foreign_sdo", "at_s": 0.1, "from": "enabled", "object": 0x6072, "value": 32767, "size": 2}
    refused = {"kind": "foreign_sdo", "at_s": 0.2, "from": "enabled", "object": "0x1018:1", "value": -1, "size": 4}
    drive, master = start_drive(script={"faults": [fault, refused]})
    master.bring_up(enable=False)
    master.enable()
    assert master.wait_for(0x581) == bytes.fromhex("6072600000000000")
    assert master.wait_for(0x581) == bytes.fromhex("8018100102000106")  # read only
    assert master.read(0x6072) == 32767
    assert _injected(drive) == [kinds.FOREIGN_SDO, kinds.FOREIGN_SDO]
