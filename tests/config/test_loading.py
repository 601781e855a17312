"""What is accepted, and what it means."""

from pathlib import Path

import pytest

from hapticd.config import Config, Effect, apply_settings, config_to_yaml, load_config, parse_config, parse_yaml
from hapticd.config.problems import ConfigError
from hapticd.effects.catalogue import CATALOGUE


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1E3", 1e3),
        ("+.5", 0.5),
        ("2.", 2.0),
        ("1_000.5", 1000.5),
        ("0x10", 16.0),
        ("7", 7.0),
        ("5.e-1", 0.5),
    ],
)
def test_number_notations(text: str, value: float) -> None:
    config = parse_yaml(f"spring: {{stiffness: {text}}}", "lab.yaml")
    assert config.spring.stiffness == value
    assert isinstance(config.spring.stiffness, float)


@pytest.mark.parametrize("text", ["217", "217.0", "2.17e2"])
def test_whole_numbers_may_be_written_as_floats(text: str) -> None:
    decimation = parse_yaml(f"encoder: {{decimation: {text}}}", "lab.yaml").encoder.decimation
    assert decimation == 217
    assert isinstance(decimation, int)


@pytest.mark.parametrize("mode", ["0660", '"0660"', "'660'"])
def test_octal_mode_with_and_without_quotes(mode: str) -> None:
    assert parse_yaml(f"api: {{mode: {mode}}}", "lab.yaml").api.mode == "0660"


@pytest.mark.parametrize(("text", "value"), [("true", True), ("yes", True), ("On", True), ("no", False)])
def test_switches(text: str, value: bool) -> None:
    assert parse_yaml(f"encoder: {{invert: {text}}}", "lab.yaml").encoder.invert is value


@pytest.mark.parametrize("text", ["off", "'off'", "OFF"])
def test_off_without_quotes_is_the_choice_of_that_name(text: str) -> None:
    safety = parse_yaml(f"safety: {{guard: {text}, passivity: {text}}}", "lab.yaml").safety
    assert (safety.guard, safety.passivity) == ("off", "off")
    assert apply_settings(Config(), {"safety.guard": "off"}).safety.guard == "off"


def test_empty_sections_mean_their_defaults() -> None:
    assert parse_yaml("servo:\n  overrun:\nspring:\n", "lab.yaml") == Config()
    assert parse_yaml("servo:\n", "lab.yaml") == Config()


def test_zero_and_null_limits_are_no_limit() -> None:
    for nothing in (0, 0.0, None):
        config = parse_config(
            {
                "amplifier": {"continuous_current": nothing, "peak_current": nothing},
                "safety": dict.fromkeys(("max_velocity", "max_excursion", "encoder_jump", "missed_exchanges"), nothing),
                "servo": {"overrun": {"fault_after": nothing}},
            },
            "x",
        )
        limits = (
            config.amplifier.continuous_current,
            config.amplifier.peak_current,
            config.safety.max_velocity,
            config.safety.max_excursion,
            config.safety.encoder_jump,
            config.safety.missed_exchanges,
            config.servo.overrun.fault_after,
        )
        assert limits == (None,) * 7


def test_zero_and_null_are_an_ideal_amplifier() -> None:
    for nothing in (0, None):
        ideal = {"bandwidth_hz": nothing, "dac_bits": nothing, "dac_full_scale": nothing}
        amplifier = parse_config({"amplifier": ideal}, "x").amplifier
        assert (amplifier.bandwidth_hz, amplifier.dac_bits, amplifier.dac_full_scale, amplifier.delay) == (
            0.0,
            0,
            0.0,
            0.0,
        )


def test_anchors_and_merge_keys() -> None:
    config = parse_yaml("spring: &wall {stiffness: 2, side: positive}\nhand: {stiffness: 3, <<: {damping: 4}}", "x")
    assert (config.spring.side, config.hand.stiffness, config.hand.damping) == ("positive", 3.0, 4.0)


def test_byte_order_mark_and_windows_lines(tmp_path: Path) -> None:
    path = tmp_path / "lab.yaml"
    path.write_bytes("\ufeffservo:\r\n  rate_hz: 500\r\n".encode())
    assert load_config(path).servo.rate_hz == 500.0
    assert load_config(str(path)) == load_config(path)


def test_driver_options_are_kept_and_cannot_change_the_configuration() -> None:
    config = parse_yaml("driver: {name: serial_dac, port: /dev/ttyUSB0, pins: [1, 2], nested: {a: null}}", "x")
    options = config.driver.options
    assert options == {"port": "/dev/ttyUSB0", "pins": [1, 2], "nested": {"a": None}}
    options["pins"].append(3)
    assert config.driver.options["pins"] == [1, 2]


def test_home_directories_are_expanded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/lab")
    config = parse_yaml("record: {directory: ~/runs}", "x")
    assert config.record.directory == "/home/lab/runs"


@pytest.mark.parametrize(
    ("environment", "socket", "directory"),
    [
        ({"XDG_RUNTIME_DIR": "/run/user/7"}, "/run/user/7/hapticd.sock", "/home/lab/.local/state/hapticd/runs"),
        ({"XDG_RUNTIME_DIR": "/r", "XDG_STATE_HOME": "/s"}, "/r/hapticd.sock", "/s/hapticd/runs"),
        (
            {"XDG_RUNTIME_DIR": "/r", "STATE_DIRECTORY": "/var/lib/hapticd:/x"},
            "/r/hapticd.sock",
            "/var/lib/hapticd/runs",
        ),
    ],
)
def test_places_come_from_the_environment(
    environment: dict[str, str], socket: str, directory: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("XDG_RUNTIME_DIR", "XDG_STATE_HOME", "STATE_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", "/home/lab")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    for config in (Config(), parse_yaml("{api: {socket: null}, record: {directory: null}}", "x")):
        assert (config.api.socket, config.record.directory) == (socket, directory)


def test_socket_without_a_runtime_directory(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr("hapticd.config.paths.SERVICE_RUNTIME", tmp_path)
    assert Config().api.socket == str(tmp_path / "hapticd.sock")
    monkeypatch.setattr("hapticd.config.paths.SERVICE_RUNTIME", tmp_path / "missing")
    assert Config().api.socket.startswith("/tmp/hapticd-")


def test_effects_are_accepted_as_floats_and_tuples() -> None:
    text = (
        "plant: {effects: [{name: stribeck, s: 0.4, omega_s: 2}, {name: torque_ripple, orders: [7], amplitudes: [1]}]}"
    )
    config = parse_yaml(text, "x")
    stribeck, ripple = config.plant.effects
    assert stribeck == Effect.model_validate({"name": "stribeck", "s": 0.4, "omega_s": 2.0})
    assert ripple.model_extra == {"orders": (7.0,), "amplitudes": (1.0,)}
    assert hash(config) == hash(parse_yaml(config_to_yaml(config), "y"))
    assert parse_config(config.model_dump(), "z") == config


@pytest.mark.parametrize("slug", CATALOGUE)
def test_every_effect_is_accepted_at_its_bounds_and_refused_beyond(slug: str) -> None:
    parameters = [
        p for p in CATALOGUE[slug].parameters if p.name not in ("on_s", "off_s", "restitution")
    ]  # the last with no stiffness
    for bound, beyond in [("lower", -1.0), ("upper", 1.0)]:
        values = {p.name: getattr(p, bound) for p in parameters}
        wrong = {
            p.name: value + beyond * (1.0 + abs(value)) for p, value in zip(parameters, values.values(), strict=True)
        }
        listed = {p.name: [values[p.name]] if p.length > 1 else values[p.name] for p in parameters}
        config = parse_config({"plant": {"effects": [{"name": slug, **listed}]}}, "x")
        assert config.plant.effects[0].name == slug
        for p in parameters:
            value = [wrong[p.name]] if p.length > 1 else wrong[p.name]
            with pytest.raises(ConfigError) as raised:
                parse_config({"plant": {"effects": [{"name": slug, **listed, p.name: value}]}}, "x")
            (problem,) = raised.value.problems
            assert problem.limit == values[p.name]
            assert problem.unit == (p.unit or None)
            assert problem.key == f"plant.effects[0].{p.name}" + ("[0]" if p.length > 1 else "")


def test_configurations_are_frozen_and_hashable() -> None:
    config = Config()
    with pytest.raises(ValueError, match="frozen"):
        config.servo.rate_hz = 1.0
    assert {config: 1}[parse_yaml("{}", "x")] == 1
