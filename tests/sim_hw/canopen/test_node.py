"""NMT, heartbeat, node guarding, several clients, the process."""

import json
import signal
import socket
import time

import pytest

from sim_hw import log
from tests import forked
from tests.polling import PATIENCE_S
from tests.sim_hw.canopen.master import DISABLED, ENABLED, FAULT, READ_DEVICE_TYPE, Master


def test_nmt_states_decide_what_is_answered(start_drive):
    _, master = start_drive()
    assert master.guard() == 127
    assert master.guard() == 0x80 | 127
    master.nmt(1)
    assert master.guard() == 5
    master.nmt(2)
    assert master.guard() == 0x80 | 4
    assert master.unanswered(0x601, 0x581, READ_DEVICE_TYPE)
    master.send(0, b"\x01\x02")  # for another node
    assert master.guard() == 0x80 | 4
    master.send(0, b"\x80\x00")  # for all
    assert master.guard() == 127


@pytest.mark.parametrize(("command", "slope"), [(129, 1000), (130, 7)])
def test_resets_send_boot_up_and_restore_what_they_should(start_drive, command, slope):
    drive, master = start_drive()
    master.bring_up()
    master.write(0x6087, 0, 7, 4)
    master.write(0x1017, 0, 500, 2)
    master.nmt(command)
    assert master.wait_for(0x701) == b"\0"
    assert master.read(0x1017) == 0
    assert master.read(0x6087) == slope
    assert master.state() == DISABLED
    assert master.read(0x1800, 1) == 0x40000181
    assert log.REBOOT in drive.stop()["event"]


def test_heartbeats_come_in_their_time_instead_of_guarding(start_drive):
    _, master = start_drive()
    master.write(0x1017, 0, 20, 2)
    assert [master.wait_for(0x701) for _ in range(4)] == [b"\x7f"] * 4
    master.write(0x1017, 0, 0, 2)
    time.sleep(0.1)
    assert master.settle() == []


def test_life_guarding_zeroes_the_current_exactly_when_due(start_drive):
    drive, master = start_drive()
    master.bring_up()
    master.write(0x100C, 0, 25, 2)
    master.write(0x100D, 0, 4, 1)
    master.command(0x0F, 300)
    before_ns = time.monotonic_ns()
    master.guard()
    after_ns = time.monotonic_ns()
    assert master.wait_for(0x81) == bytes.fromhex("3081 11 00100000 00")
    assert master.guard() & 0x7F == 127  # 0x1029:1 = 0: Pre-operational
    master.wait_state(FAULT)
    rows = drive.stop()
    emergency = rows[rows["event"] == log.EMCY][0]
    assert emergency["code"] == 0x8130
    disabled = rows[rows["event"] == log.DISABLE][0]
    assert disabled["time_ns"] == emergency["time_ns"]
    # The log has no row of its own for a guarding request; it has this process' clock.
    assert before_ns < disabled["time_ns"] - 100_000_000 < after_ns
    zero = rows[(rows["event"] == log.APPLIED) & (rows["time_ns"] > disabled["time_ns"])][0]
    assert zero["applied_A"] == 0.0
    assert zero["time_ns"] - disabled["time_ns"] == 74_273  # T_A = 2 δ/ω = 74 272.3 ns, rounded up


def test_abort_option_0_keeps_the_state_and_guarding_can_be_stopped(start_drive):
    _, master = start_drive()
    master.bring_up()
    master.write(0x6007, 0, 0, 2)
    master.write(0x100C, 0, 10, 2)
    master.write(0x100D, 0, 2, 1)
    master.guard()
    assert master.wait_for(0x81)[:2] == (0x8130).to_bytes(2, "little")
    assert master.state() == ENABLED


def test_clients_see_each_other_and_a_fifth_is_turned_away(start_drive):
    drive, first = start_drive()
    others = [Master(drive.socket) for _ in range(3)]
    first.read(0x1000)
    first.send(0x123, b"hello")
    for other in others:
        assert other.wait_for(0x123) == b"hello"
    assert 0x123 not in [frame[0] for frame in first.settle()]
    fifth = Master(drive.socket)
    with pytest.raises(EOFError):
        fifth.receive()
    for client in (*others, fifth):
        client.close()
    again = Master(drive.socket)
    assert again.read(0x1000) == 0x00020192
    again.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(start_drive, number):
    drive, master = start_drive()
    assert drive.ready | {"pid": 0} == {
        "ready": True,
        "device": "canopen",
        "node_id": 1,
        "socket": str(drive.socket),
        "pid": 0,
    }
    assert drive.socket.is_socket()
    master.bring_up()
    master.command(0x0F, 100)
    rows = drive.stop(number)
    assert drive.returncode == 0
    assert drive.stderr == ""
    assert not drive.socket.exists()
    assert rows["event"][0] == log.START
    assert rows["event"][-1] == log.END
    assert (rows["time_ns"][1:] >= rows["time_ns"][:-1]).all()


def test_a_socket_in_use_or_bad_options_are_clear_errors(start_drive, tmp_path):
    drive, _ = start_drive()
    script = tmp_path / "bad.yaml"
    script.write_text(json.dumps({"faults": [{"kind": "bus_of", "at_s": 1}], "start": {"override": {"0x10": 1}}}))
    for arguments, code, words in (
        ([str(drive.socket)], 4, "cannot listen on"),
        ([str(tmp_path / "x"), "--script", str(script)], 2, "bus_off"),
        ([str(tmp_path / "x"), "--node-id", "128"], 2, "1 to 127"),
        ([str(tmp_path / "x"), "--set", "0x6076"], 2, "INDEX[:SUB]=VALUE"),
        ([str(tmp_path / "x"), "--set", "0x5000=1"], 2, "command line: 0x5000 = 1: the drive has no such object"),
        (
            [str(tmp_path / "x"), "--bus", "port=1"],
            2,
            "command line: --bus: is for interfaces of python-can only",
        ),
    ):
        refused = forked.device(["canopen", "--socket", *arguments], tmp_path)
        _, said = refused.communicate(PATIENCE_S)
        assert refused.returncode == code, said
        assert words in said
    assert not (tmp_path / "x").exists()


def test_a_stale_socket_is_replaced(start_drive, tmp_path):
    stale = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    stale.bind(str(tmp_path / "can"))
    stale.close()
    _, master = start_drive()
    assert master.read(0x1000) == 0x00020192
