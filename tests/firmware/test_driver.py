"""The host's half of docs/protocols/serial-dac.md: the real driver against every device."""

import contextlib
import signal
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers import DriverError
from drivers.interface import (
    DEVICE_FAULT,
    LOST,
    MISSED,
    OK,
    STATUS_ENABLED,
    STATUS_HELD,
    X_COUNTS,
    X_DEVICE_CODE,
    X_STATUS,
)
from drivers.serial_dac import SerialDacDriver, budget
from tests.drivers.serial.expected_exchange import IMPATIENT_S, Loop, config, line_errors
from tests.firmware.citations import PAGE, cites, statements
from tests.firmware.devices import Device, currents
from tests.polling import wait_until
from tests.sim_hw.boards import Board, rows
from tests.sim_hw.host import AMPLIFIER_FAULT, ENCODER_FAULT, EXTERNAL_STOP, WATCHDOG

WATCHDOG_MS = 2000
AT_S = 0.05


@contextlib.contextmanager
def driven(
    device: Device, folder: Path, script: str = "", watchdog_ms: int = WATCHDOG_MS, *, enable: bool = False
) -> Iterator[tuple[Board, SerialDacDriver, Loop]]:
    """A device with the driver open on it."""
    with device.running(folder, script) as board:
        driver = SerialDacDriver(
            config(
                str(board.link),
                driver={"watchdog_ms": watchdog_ms},
                amplifier={"dac_bits": bits(device)},
                safety={"enable": enable},
            )
        )
        try:
            driver.open()
            yield board, driver, Loop(driver)
        finally:
            driver.close()


def bits(device: Device) -> int:
    return 12 if device.name == "avr-uno" else 14


def enable(loop: Loop) -> None:
    def enabled() -> bool:
        assert loop.read() == OK
        assert loop.write(0, 1) == OK
        return bool(loop.x[X_STATUS] & STATUS_ENABLED)

    wait_until(enabled, "the amplifier")


def fault(keys: str) -> str:
    return f"faults: [{{at_s: {AT_S}, from: enabled, {keys}}}]"


@cites(
    "8 data bits, no parity, 1 stop bit",
    "Opening the port may toggle DTR",
    "Host opens the port, discards what is in its buffers",
    "CONFIGURE → reply with the same watchdog time",
    "COMMAND (mid-scale, enable 0), then SAMPLE",
    "One exchange a period",
    "Start: COMMANDs with enable 1 at mid-scale",
    "End: twice COMMAND (mid-scale, enable 0)",
    "seq grows by one a SAMPLE",
)
def test_a_session(device: Device, tmp_path: Path) -> None:
    with driven(device, tmp_path) as (board, driver, loop):
        line = termios.tcgetattr(driver._port.fileno()) if driver._port else []
        assert line[2] & termios.CSIZE == termios.CS8
        assert not line[2] & (termios.PARENB | termios.CSTOPB | termios.CRTSCTS)
        assert not line[0] & (termios.IXON | termios.IXOFF)
        assert "watchdog 2000 ms" in driver.describe()
        assert loop.read() == OK
        assert loop.x[X_STATUS] == 0
        enable(loop)
        for code in (100, -200, *(300 for _ in range(300))):  # seq comes round
            assert loop.read() == OK
            assert loop.write(code, 1) == OK
        assert line_errors(driver) == (0, 0)
        driver.close()
        board.wait_for_event("DISABLE")
        log = board.stop()
    step = 6.0 / (1 << (bits(device) - 1))
    assert currents(log) == pytest.approx([0.0, 100 * step, -200 * step, 300 * step, 0.0])


@cites("Host checks version, ranges", "the host refuses a version other than its own")
def test_a_board_that_is_not_as_configured_is_refused(device: Device, tmp_path: Path) -> None:
    with device.running(tmp_path, "faults: [{kind: wrong_version}]") as board:
        with pytest.raises(DriverError, match="has version 255 of the protocol, this driver version 1"):
            SerialDacDriver(config(str(board.link))).open()
        for change, said in (
            ({"dac_bits": 10}, f"dac_bits = 10 bits, but the board's DAC has {bits(device)} bits"),
            ({"dac_bits": bits(device), "dac_full_scale": 5.0}, "= 5 A, but the board's full scale is 6 A"),
        ):
            folder = tmp_path / said[:9]
            folder.mkdir(exist_ok=True)
            with device.running(folder) as other:
                driver = SerialDacDriver(config(str(other.link), amplifier=change))
                with pytest.raises(DriverError, match=said):
                    driver.open()
                driver.close()


@pytest.mark.parametrize(
    ("kind", "bit"),
    [("encoder_fault", ENCODER_FAULT), ("amplifier_fault", AMPLIFIER_FAULT), ("external_stop", EXTERNAL_STOP)],
)
@cites("ENCODER_FAULT, AMPLIFIER_FAULT, WATCHDOG or EXTERNAL_STOP", "Fault in the board")
def test_faults_of_the_board(device: Device, tmp_path: Path, kind: str, bit: int) -> None:
    with driven(device, tmp_path, fault(f"kind: {kind}")) as (_, _, loop):
        enable(loop)

        def told() -> bool:
            found = loop.read()
            loop.write(100, 1)
            return found == DEVICE_FAULT

        wait_until(told, kind)
        assert loop.x[X_DEVICE_CODE] & ~0x20 == bit  # the COMMANDs meanwhile may have been refused
        assert loop.x[X_STATUS] == 0


@cites("HELD clear, or a SAMPLE reply", "With safety.enable every SAMPLE is a SAMPLE_INPUTS", "is refused.")
def test_the_enable_that_a_person_holds(device: Device, tmp_path: Path) -> None:
    with driven(device, tmp_path, fault("kind: enable_released"), enable=True) as (board, _, loop):
        enable(loop)
        assert loop.x[X_STATUS] & STATUS_HELD

        def released() -> bool:
            assert loop.read() == OK
            loop.write(100, 1)
            return not loop.x[X_STATUS] & STATUS_HELD

        wait_until(released, "the release")
        board.wait_for_event("DISABLE")
        assert loop.read() == OK
        assert loop.x[X_STATUS] == 0


@cites("ENCODER_FAULT, AMPLIFIER_FAULT, WATCHDOG or EXTERNAL_STOP", "UNCONFIGURED: the board has restarted")
def test_watchdog_and_reboot(device: Device, tmp_path: Path) -> None:
    script = "faults: [{at_s: 0, from: signal, kind: reboot, off_s: 0.05}]"
    with driven(device, tmp_path, script, 200) as (board, _, loop):
        enable(loop)
        board.wait_for_event("DISABLE")
        assert loop.read() == DEVICE_FAULT
        assert loop.x[X_DEVICE_CODE] == WATCHDOG
        board.process.send_signal(signal.SIGUSR1)
        board.wait_for_event("REBOOT", 2)
        assert loop.read() == LOST
        assert (loop.write(100, 1), loop.read()) == (LOST, LOST)


@cites("no reply with this seq within the reply time-out", "bad frame | discarded; counted")
def test_lost_and_corrupt_replies(device: Device, tmp_path: Path) -> None:
    for kind in ("drop", "corrupt"):
        folder = tmp_path / kind
        folder.mkdir()
        with driven(device, folder, fault(f"kind: {kind}, frames: reply")) as (_, driver, loop):
            enable(loop)
            time.sleep(2 * AT_S)
            counts = int(loop.x[X_COUNTS])
            assert loop.read(IMPATIENT_S) == MISSED
            assert loop.x[X_COUNTS] == counts
            assert loop.write(0, 1) == OK
            assert loop.read() == OK
            assert line_errors(driver) == (0, int(kind == "corrupt"))


@cites(
    "reply with another seq (late, duplicated)",
    "A reply 256 periods old",
    "The board must not send a SAMPLE reply later",
)
def test_a_reply_that_comes_twice(device: Device, tmp_path: Path) -> None:
    with driven(device, tmp_path, fault("kind: duplicate, frames: reply")) as (_, driver, loop):
        enable(loop)
        time.sleep(2 * AT_S)
        for _ in range(3):
            assert loop.read() == OK
            assert loop.write(0, 1) == OK
        assert line_errors(driver) == (1, 0)


@cites("command_seq is not that of the last COMMAND")
def test_a_lost_command_is_noticed(device: Device, tmp_path: Path) -> None:
    with driven(device, tmp_path, fault("kind: drop, frames: command")) as (_, _, loop):
        enable(loop)
        time.sleep(2 * AT_S)
        assert loop.read() == OK
        assert loop.write(5, 1) == OK  # this one is lost
        assert loop.read() == OK
        assert loop.write(5, 1) == MISSED
        assert loop.read() == OK
        assert loop.write(5, 1) == OK


@cites("line hung up, port gone")
def test_unplugged(device: Device, tmp_path: Path) -> None:
    with driven(device, tmp_path, fault("kind: unplug")) as (board, _, loop):
        enable(loop)
        wait_until(lambda: loop.read(IMPATIENT_S) == LOST, "the port to go")
        assert loop.write(0, 1) == LOST
        board.wait_for_event("DISABLE")  # the watchdog's


@cites(
    "The host removes the wrap",
    "So the encoder must move less",
    "The first reply of a session sets the position",
    "Count.",
)
def test_the_wrap_is_removed(device: Device, tmp_path: Path) -> None:
    if device.name == "avr-uno":
        pytest.skip("its counter begins at zero")
    script = "{start: {counts_offset: -40}, hand: [{at_s: 0.02, force: 0.004, from: enabled}]}"
    with driven(device, tmp_path, script) as (board, _, loop):
        assert loop.read() == OK
        first = int(loop.x[X_COUNTS])
        assert -42 <= first <= -39
        loop.write(0, 1)
        last = first
        while last < 40:
            assert loop.read() == OK
            loop.write(0, 1)
            assert 0 <= loop.x[X_COUNTS] - last < 8192
            last = int(loop.x[X_COUNTS])
        assert rows(board.stop(), "SAMPLE")["counts"][-1] > 0  # seen on its way to the board


@cites(
    "Wire times at 10 bits a byte",
    "An exchange is 31 bytes",
    *(f"{baud} | " for baud in (115200, 230400, 460800, 921600, 1000000, 2000000, 3000000, 12000000)),
)
def test_wire_times() -> None:
    lines = [
        [float(cell) for cell in line.split(" | ")]
        for line in statements(PAGE.read_text())
        if line[:1].isdigit() and line.count(" | ") == 6
    ]
    assert len(lines) == 8
    for baud, *told in lines:
        sizes = (budget.SAMPLE_BYTES, budget.REPLY_BYTES, budget.COMMAND_BYTES, budget.EXCHANGE_BYTES)
        sizes = (*sizes, budget.REPLY_BYTES + budget.COMMAND_BYTES)
        expected = [1e6 * budget.wire_s(size, int(baud)) for size in sizes]
        assert told[:-1] == pytest.approx(expected, abs=0.051)
        assert told[-1] == int(budget.fastest_rate_hz(int(baud)))
