"""What is refused before any port is opened, and in which words; budget and declared latency."""

from typing import Any

import pytest

import drivers
from drivers import DriverConfigError
from drivers.serial_dac import SerialDacDriver, budget
from tests.drivers.serial.expected_exchange import config


def driver(**changes: Any) -> SerialDacDriver:
    plain = {"watchdog_ms": ..., "reply_timeout_s": ...}
    changes["driver"] = {**plain, **changes.get("driver", {})}
    made = drivers.create(config(**{"servo": {"rate_hz": 1000}, **changes}))
    assert isinstance(made, SerialDacDriver)
    return made


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"driver": {"port": ...}}, "driver.port is missing; serial_dac needs the device's path, such as /dev/ttyUSB0"),
        ({"driver": {"port": 3}}, "driver.port = 3: must be a path"),
        ({"driver": {"bauds": 9600}}, "driver.bauds: driver serial_dac has no such option; did you mean driver.baud?"),
        ({"driver": {"zzz": 1}}, "driver.zzz: driver serial_dac has no such option; it has: port, baud, watchdog_ms"),
        ({"driver": {"baud": 300}}, "driver.baud = 300: must be from 1200 to 50000000 baud"),
        ({"driver": {"baud": "fast"}}, "driver.baud = fast: must be a whole number of baud"),
        ({"driver": {"baud": True}}, "driver.baud = true: must be a whole number of baud"),
        ({"driver": {"watchdog_ms": 2.5}}, "driver.watchdog_ms = 2.5: must be a whole number of ms"),
        ({"driver": {"watchdog_ms": 70000}}, "driver.watchdog_ms = 70000: must be from 1 to 65535 ms"),
        (
            {"driver": {"watchdog_ms": 1}},
            "servo.rate_hz = 1000 Hz: driver.watchdog_ms = 1 ms must be at least 2 servo periods, 2 ms at 1000 Hz",
        ),
        ({"driver": {"reply_timeout_s": "soon"}}, "driver.reply_timeout_s = soon: must be a number of seconds"),
        ({"driver": {"reply_timeout_s": 1e-4}}, "driver.reply_timeout_s = 0.0001: must be from 0.000239 to 1 s"),
        (
            {"driver": {"reply_timeout_s": 0.00095}},
            "servo.rate_hz = 1000 Hz: driver.reply_timeout_s = 0.00095 s leaves no time for the command: "
            "at most 0.000902 s at 1000 Hz and 921600 baud",
        ),
        ({"driver": {"latency_s": -1}}, "driver.latency_s = -1: must be from 0 to 1 s"),
        (
            {"driver": {"baud": 115200}},
            "servo.rate_hz = 1000 Hz: an exchange of 31 bytes takes 2691 µs at driver.baud = 115200, and may take 80% of "
            "the period of 1000 µs: at most 297 Hz, or at least 387500 baud for 1000 Hz",
        ),
        ({"amplifier": {"dac_bits": 0}}, "amplifier.dac_bits = 0: a serial board has 8 … 16 bits"),
        ({"amplifier": {"dac_bits": 18}}, "amplifier.dac_bits = 18: a serial board has 8 … 16 bits"),
    ],
)
def test_a_refusal_names_key_value_and_limit(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(DriverConfigError) as caught:
        driver(**changes)
    assert str(caught.value).startswith(said)


def test_the_limits_themselves_are_accepted() -> None:
    driver(driver={"baud": 387_500})
    driver(driver={"watchdog_ms": 2, "reply_timeout_s": 0.0009, "latency_s": 0})


def test_a_rate_that_the_line_cannot_carry_is_refused_while_running() -> None:
    open_driver = driver(driver={"baud": 460_800})
    assert open_driver.check_rate(1189) is None
    assert "at most 1189 Hz, or at least 465000 baud for 1200 Hz" in (open_driver.check_rate(1200) or "")
    assert "driver.watchdog_ms = 20 ms must be at least 2 servo periods, 40 ms at 50 Hz" in (
        open_driver.check_rate(50) or ""
    )


@pytest.mark.parametrize("baud", [1200, 115_200, 921_600, 12_000_000])
def test_the_named_limits_are_each_others_inverse(baud: int) -> None:
    rate = budget.fastest_rate_hz(baud)
    assert budget.rate_refusal(rate, baud, 60_000, None) is None
    assert budget.rate_refusal(rate * 1.001, baud, 60_000, None) is not None
    assert budget.slowest_baud(rate) == pytest.approx(baud, abs=1)


def test_the_frames_have_the_lengths_of_the_budget() -> None:
    from drivers.serial_dac import messages
    from drivers.serial_dac.framing import frame

    assert len(frame(messages.sample(0))) == budget.SAMPLE_BYTES == 6
    assert len(frame(messages.command(0, 8192, enable=True))) == budget.COMMAND_BYTES == 9
    assert budget.REPLY_BYTES == 16


def test_the_declared_latency_follows_baud_and_option() -> None:
    assert drivers.declared_latency(config()) == (pytest.approx(250 / 921_600 + 40e-6), None)
    slow = config(driver={"baud": 115_200, "reply_timeout_s": ...}, servo={"rate_hz": 100})
    assert drivers.declared_latency(slow) == (pytest.approx(250 / 115_200 + 40e-6), None)
    assert SerialDacDriver(slow).latency_s == pytest.approx(250 / 115_200 + 40e-6)
    assert drivers.declared_latency(config(driver={"latency_s": 4e-4})) == (4e-4, None)
    latency, doubt = drivers.declared_latency(config(driver={"speed": 1}))
    assert latency == 0.0
    assert doubt is not None
    assert doubt.startswith("driver.speed: driver serial_dac has no such option")
    assert "latency of driver 'serial_dac' is not known" in doubt
