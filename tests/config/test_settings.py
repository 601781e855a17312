"""Single settings by dotted key, as in ``hapticd set servo.rate_hz=500``."""

import pytest

from hapticd.config import LIVE_KEYS, Config, ConfigError, apply_settings, load_config, unit_of


def test_settings_are_yaml_scalars() -> None:
    changed = apply_settings(
        Config(),
        {
            "servo.rate_hz": "500",
            "encoder.decimation": "217",
            "spring.stiffness": "1.2e-2",
            "spring.half_tick_bias": "false",
            "servo.overrun.policy": "hold",
            "amplifier.peak_current": "null",
            "safety.max_velocity": "0",
        },
    )
    assert (changed.servo.rate_hz, changed.encoder.decimation, changed.spring.stiffness) == (500.0, 217, 0.012)
    assert (changed.spring.half_tick_bias, changed.servo.overrun.policy) == (False, "hold")
    assert (changed.amplifier.peak_current, changed.safety.max_velocity) == (None, None)


def test_settings_may_be_plain_values() -> None:
    assert apply_settings(Config(), {"servo.rate_hz": 250}).servo.rate_hz == 250.0


def test_the_original_is_unchanged() -> None:
    config = load_config("delta")
    assert apply_settings(config, {"servo.rate_hz": "100"}) != config
    assert config == load_config("delta")
    assert apply_settings(config, {}) == config


def test_driver_options_can_be_set() -> None:
    options = apply_settings(Config(), {"driver.port": "/dev/ttyS0", "driver.nested.pins": "[1, 2]"}).driver.options
    assert options == {"port": "/dev/ttyS0", "nested": {"pins": [1, 2]}}


@pytest.mark.parametrize(
    ("key", "text", "message"),
    [
        ("servo.rate_hz", "0", "servo.rate_hz = 0: must be at least 1 Hz"),
        ("servo.rat_hz", "5", "servo.rat_hz: unknown key; did you mean servo.rate_hz?"),
        ("servo", "5", "servo: is a section; set one of its keys, such as servo.rate_hz"),
        ("servo.overrun", "skip", "servo.overrun: is a section; set one of its keys, such as servo.overrun.policy"),
        ("spring.stiffness", "a: [", 'spring.stiffness = "a: [": is not a YAML value'),
        ("spring.side", "", "spring.side = null: must be one of both, positive, negative"),
        (
            "amplifier.continuous_current",
            "7",
            "amplifier.peak_current = 6: must be at least 7 A, amplifier.continuous_current",
        ),
    ],
)
def test_wrong_setting_says_exactly(key: str, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as raised:
        apply_settings(Config(), {key: text})
    assert str(raised.value) == f"command line: {message}"


def test_all_wrong_settings_are_reported_with_their_source() -> None:
    with pytest.raises(ConfigError) as raised:
        apply_settings(Config(), {"x.y": "1", "servo.rate_hz": "0", "spring.stiffness": "-1"}, source="request")
    assert [str(problem) for problem in raised.value.problems] == [
        "request: x.y: unknown key",
        "request: servo.rate_hz = 0: must be at least 1 Hz",
        "request: spring.stiffness = -1: must be at least 0 N m/rad",
    ]


def test_a_setting_does_not_change_the_kind_of_device() -> None:
    with pytest.raises(ConfigError, match="cannot change a rotary device to a linear one"):
        apply_settings(Config(), {"encoder.counts_per_rev": "null", "encoder.counts_per_metre": "1e5"})


def test_live_keys() -> None:
    assert {"servo.rate_hz", "servo.overrun.policy", "spring.stiffness", "encoder.decimation"} <= LIVE_KEYS
    assert {"dither.amplitude", "delay.computation_s", "safety.max_velocity"} <= LIVE_KEYS
    sections = {key.partition(".")[0] for key in LIVE_KEYS}
    assert sections == {"servo", "spring", "encoder", "dither", "delay", "safety", "record"}
    assert {key for key in LIVE_KEYS if key.startswith("record.")} == {"record.subject", "record.condition"}
    assert not LIVE_KEYS & {"servo.priority", "encoder.counts_per_rev", "encoder.invert"}


def test_units() -> None:
    assert (unit_of("plant.inertia"), unit_of("plant.inertia", linear=True)) == ("kg m²", "kg")
    assert (unit_of("servo.rate_hz", linear=True), unit_of("servo.priority"), unit_of("no.key")) == ("Hz", "", "")
