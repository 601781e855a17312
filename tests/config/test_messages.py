"""What a user reads when a configuration is wrong: the exact text."""

from pathlib import Path

import pytest

from hapticd.config import ConfigError, load_config, parse_config, parse_yaml
from hapticd.config.text import significant

SECTIONS = "servo, spring, encoder, dither, delay, amplifier, plant, hand, driver, safety, record, api"
ALIASES = [("1", "a"), ("*a", "b"), ("*b", "c"), ("*c", "d"), ("*d", "e")]

WRONG = [
    # numbers and their limits
    ("servo: {rate_hz: 0}", "servo.rate_hz = 0: must be at least 1 Hz"),
    ("servo: {rate_hz: 1e6}", "servo.rate_hz = 1000000: must be at most 20000 Hz"),
    ("servo: {rate_hz: true}", "servo.rate_hz = true: must be a number in Hz"),
    ("servo: {rate_hz: null}", "servo.rate_hz = null: must be a number in Hz"),
    ("servo: {rate_hz: .nan}", "servo.rate_hz = .nan: must be finite"),
    ("servo: {rate_hz: fast}", "servo.rate_hz = fast: must be a number in Hz"),
    ("servo: {rate_hz: [1, 2]}", "servo.rate_hz = [1, 2]: must be a number in Hz"),
    ('servo: {rate_hz: "1e3"}', 'servo.rate_hz = "1e3": must be a number in Hz; write 1000 without quotes'),
    ("servo: {rate_hz: 2024-01-01}", 'servo.rate_hz = "2024-01-01": must be a number in Hz'),
    ("servo: {priority: 100}", "servo.priority = 100: must be at most 99"),
    ("servo: {priority: 0}", "servo.priority = 0: must be at least 1"),
    ("servo: {cpu: -1}", "servo.cpu = -1: must be at least 0"),
    (
        "servo: {overrun: {fault_after: 1.5}}",
        "servo.overrun.fault_after = 1.5: must be a whole number of periods",
    ),
    ("spring: {stiffness: -1}", "spring.stiffness = -1: must be at least 0 N m/rad"),
    ("encoder: {decimation: 217.5}", "encoder.decimation = 217.5: must be a whole number of counts"),
    ("encoder: {decimation: 0}", "encoder.decimation = 0: must be at least 1 counts"),
    ("encoder: {counts_per_rev: 0}", "encoder.counts_per_rev = 0: must be at least 1 counts/rev"),
    ("delay: {computation_s: 1.5}", "delay.computation_s = 1.5: must be at most 1 s"),
    ("amplifier: {dac_bits: 25}", "amplifier.dac_bits = 25: must be at most 24 bits"),
    ("amplifier: {torque_constant: 0}", "amplifier.torque_constant = 0: must be above 0 N m/A"),
    (
        "amplifier: {continuous_current: .inf}",
        "amplifier.continuous_current = .inf: must be finite (0 or null: no limit)",
    ),
    ("plant: {inertia: -1e-6}", "plant.inertia = -1.0e-06: must be above 0 kg m²"),
    ("plant: {coulomb: 1e400}", "plant.coulomb = .inf: must be finite"),
    (
        "spring: {stiffness: 1e-40}",
        "spring.stiffness = 1.0e-40: must be 0, or of 1e-18 to 1e+18 N m/rad in magnitude",
    ),
    ("hand: {damping: -1}", "hand.damping = -1: must be at least 0 N m s/rad"),
    ("safety: {max_velocity: -3}", "safety.max_velocity = -3: must be at least 0 rad/s (0 or null: no limit)"),
    (
        "servo: {clock: sync}\nsafety: {missed_exchanges: 0}",
        "safety.missed_exchanges = null: must be a number with servo.clock = sync: otherwise a producer that stops would "
        "cause no tick and no fault",
    ),
    ("safety: {heartbeat_timeout_s: 0}", "safety.heartbeat_timeout_s = 0: must be at least 0.2 s"),
    # names, switches, text
    (
        "servo: {overrun: {policy: skp}}",
        "servo.overrun.policy = skp: must be one of skip, hold, fault; did you mean skip?",
    ),
    ("spring: {side: left}", "spring.side = left: must be one of both, positive, negative"),
    (
        "dither: {waveform: sin}",
        "dither.waveform = sin: must be one of sine, triangle, square, uniform; did you mean sine?",
    ),
    ("spring: {half_tick_bias: 1}", "spring.half_tick_bias = 1: must be true or false"),
    ('record: {enabled: "no"}', 'record.enabled = "no": must be true or false'),
    ("record: {directory: 5}", "record.directory = 5: must be text"),
    ('api: {socket: ""}', 'api.socket = "": must be a path'),
    ("api: {mode: 660}", 'api.mode = 660: must be octal permissions in quotes, such as "0660"'),
    # keys and sections
    ("spring: {stifness: 3}", "spring.stifness: unknown key; did you mean spring.stiffness?"),
    ("serv: {rate_hz: 500}", "serv: unknown key; did you mean servo?"),
    ("rate_hz: 500", "rate_hz: unknown key; did you mean servo.rate_hz?"),
    ("plant: {stiffness: 3}", "plant.stiffness: unknown key; did you mean spring.stiffness?"),
    ("amplifier: {freqency: 3}", "amplifier.freqency: unknown key; did you mean dither.frequency_hz?"),
    ("hand: {zzz: 3}", "hand.zzz: unknown key; valid in hand: inertia, damping, stiffness"),
    ("5: 3", f"5: unknown key; valid here: {SECTIONS}"),
    ("servo: 5", "servo = 5: must be a section of keys, such as servo: {rate_hz: …}"),
    (
        "servo: rate_hz:1000",
        'servo = "rate_hz:1000": must be a section of keys, such as servo: {rate_hz: …}; put a space after the colon',
    ),
    ("servo: {overrun: skip}", "servo.overrun = skip: must be a section of keys, such as overrun: {policy: …}"),
    ("- servo", "must be a mapping of sections, such as servo: {rate_hz: 1000}"),
    ("version: 2", "version = 2: is from a newer hapticd; this one reads up to version 1: install the newer one"),
    ("version: 0", "version = 0: is not a version; this hapticd writes 1"),
    ('version: "1"', 'version = "1": is not a version; this hapticd writes 1'),
    # between keys
    (
        "encoder: {counts_per_rev: 8192, counts_per_metre: 1e5}",
        "encoder: counts_per_rev and counts_per_metre are both given; give one, or set the other to null",
    ),
    (
        "encoder: {counts_per_rev: null}",
        "encoder: needs counts_per_rev (rotary device) or counts_per_metre (linear device)",
    ),
    (
        "amplifier: {peak_current: 1}",
        "amplifier.peak_current = 1: must be at least 2 A, amplifier.continuous_current",
    ),
    (
        "amplifier: {dac_full_scale: 0}",
        "amplifier.dac_full_scale = 0: must be above 0 A when amplifier.dac_bits is 14",
    ),
    (
        "amplifier: {bandwidth_hz: 0.01}",
        "amplifier.bandwidth_hz = 0.01: is a lag of 22281.7 servo periods; must be at most 4000: "
        "must be at least 0.05576 Hz, or 0 for no lag",
    ),
    (
        "dither: {target: position, amplitude: 1, frequency_hz: 500}",
        "dither.frequency_hz = 500: must be below 500 Hz, half of servo.rate_hz",
    ),
    ("dither: {target: position}", "dither.frequency_hz = 0: must be above 0 Hz for a sine dither"),
    (
        "dither: {target: current, waveform: uniform, amplitude: 7}",
        "dither.amplitude = 7: must be at most 6 A, amplifier.peak_current",
    ),
    (
        "{encoder: {counts_per_metre: 1e12}, spring: {origin: 1e6}}",
        "spring.origin = 1000000: is 1e+18 encoder counts from zero; must be at most 9.01e+15",
    ),
    # drivers and effects
    ("driver: {port: /dev/ttyUSB0}", "driver.name: is missing: name the driver that these options are for"),
    ("driver: {nmae: loopback}", "driver.nmae: unknown key; did you mean driver.name?"),
    ('driver: {name: ""}', 'driver.name = "": must name a driver, such as loopback'),
    ("driver: {name: x, gains: [1, .inf]}", "driver.gains[1] = .inf: must be finite"),
    ("driver: loopback", "driver = loopback: must be a section of keys, such as driver: {name: …}"),
    (
        "plant: {effects: [{name: stribeck, omega_s: 3}]}",
        "plant.effects[0].s: is missing; stribeck needs s, omega_s",
    ),
    (
        "plant: {effects: [{name: stribeck, s: 0.4, omega_s: 3, omega: 2}]}",
        "plant.effects[0].omega: unknown parameter of stribeck; did you mean omega_s?",
    ),
    (
        "plant: {effects: [{name: stribeck, s: 11, omega_s: 3}]}",
        "plant.effects[0].s = 11: must be at most 10",
    ),
    (
        "plant: {effects: [{name: backlash, gap: -0.1}]}",
        "plant.effects[0].gap = -0.1: must be at least 0 rad (m on a linear device)",
    ),
    (
        "plant: {effects: [{name: backlash, gap: 0.1, damping: 0.01}]}",
        "plant.effects[0].damping = 0.01: is for a contact with a stiffness; a rigid contact has a restitution",
    ),
    (
        "plant: {effects: [{name: backlash, gap: 0.1, stiffness: 2, restitution: 0.5}]}",
        "plant.effects[0].restitution = 0.5: is for a rigid contact; a contact with a stiffness has a damping instead",
    ),
    (
        "plant: {effects: [{name: transport_delay, t_d: soon}]}",
        "plant.effects[0].t_d = soon: must be a number in s",
    ),
    ("plant: {effects: [{name: gravity, m_g_l: .inf}]}", "plant.effects[0].m_g_l = .inf: must be finite"),
    (
        "plant: {effects: [{name: constant_bias, tau_0: -1e-30}]}",
        "plant.effects[0].tau_0 = -1.0e-30: must be 0, or of 1e-18 to 1e+18 N m (N on a linear device) in magnitude",
    ),
    (
        "plant: {effects: [{name: dropped_samples, p: 0.1}, {name: dropped_samples, p: 0.2}]}",
        "plant.effects[1].name = dropped_samples: given twice, here and as plant.effects[0]",
    ),
    (
        "plant: {effects: [{name: backlash, gap: 0.1}, {name: flexible_coupling, f_r: 20}]}",
        "plant.effects[1].name = flexible_coupling: excludes backlash, plant.effects[0]; give one of them",
    ),
    (
        "plant: {effects: [{name: torque_ripple, orders: 7, amplitudes: [1]}]}",
        "plant.effects[0].orders = 7: must be a list of up to 8 numbers in 1/rev (rad/m on a linear device)",
    ),
    (
        "plant: {effects: [{name: torque_ripple, orders: [7, 14], amplitudes: [1]}]}",
        "plant.effects[0].amplitudes: has 1 numbers for 2 orders",
    ),
    (
        "plant: {effects: [{name: hand_impedance, k_h: 1, on_s: 3, off_s: 2}]}",
        "plant.effects[0].off_s = 2: must be above on_s = 3 s",
    ),
    (
        "plant: {effects: [{name: stribek}]}",
        "plant.effects[0].name = stribek: unknown effect; did you mean stribeck?",
    ),
    (
        "plant: {effects: [stribeck]}",
        "plant.effects[0] = stribeck: must be a mapping with the effect's name, such as {name: stribeck}",
    ),
    (
        "plant: {effects: {name: stribeck}}",
        "plant.effects = {name: stribeck}: must be a list of effects, such as [{name: stribeck, s: 0.4, omega_s: 3}]",
    ),
    # YAML itself
    ("", "is empty; write {} for the built-in defaults"),
    ("# nothing yet\n", "is empty; write {} for the built-in defaults"),
    ("spring: {stiffness: 1}\nspring: {origin: 1}", "spring: given twice, on lines 1 and 2"),
    ("spring: {side: both, side: both}", "spring.side: given twice, on line 1"),
    ("spring:\n\tstiffness: 1", "line 2, column 1: a tab; YAML must be indented with spaces"),
    (
        "a: b: c",
        "line 1, column 5: not valid YAML: a ':' where no key is expected; check the indentation of the lines above",
    ),
    (
        "spring: {stiffness: 1",
        "line 1, column 22: not valid YAML while parsing a flow mapping: expected ',' or '}', but got '<stream end>'",
    ),
    ("{}\n---\n{}", "line 2, column 1: a second document starts here; one file holds one configuration"),
    ("servo: {cpu: \0}", "line 1: character U+0000 is not allowed in YAML"),
    ("servo: {cpu: !!binary YQ==}", 'servo.cpu: line 1: "YQ==" cannot be read as binary'),
    ("servo: &loop {overrun: *loop}", "servo.overrun: an alias that contains itself"),
    ("servo: !%0A", 'servo: line 1: "" cannot be read as "!\\n"'),
    ("? [a, b]\n: 1", "line 1: a key must be a plain word"),
    ("servo: {<<: 5}", "servo: line 1: << needs a mapping"),
    ("[" * 5000, "is nested too deeply"),
    (
        "\n".join(f"{name}: &{name} [{', '.join([item] * 10)}]" for item, name in ALIASES),
        "holds more than 20000 values; this is not a configuration file",
    ),
    ('{"a\\nb": 1}', f"'a\\nb': unknown key; valid here: {SECTIONS}"),
]


@pytest.mark.parametrize(("text", "message"), WRONG)
def test_wrong_configuration_says_exactly(text: str, message: str) -> None:
    with pytest.raises(ConfigError) as raised:
        parse_yaml(text, "lab.yaml")
    assert str(raised.value) == f"lab.yaml: {message}"


def test_all_problems_are_reported_at_once() -> None:
    text = """\
servo: {rate_hz: 0, prioritty: 80}
spring: {stiffness: soft}
encoder: {decimation: 2.5, decimation: 3}
dither: {target: current, waveform: uniform, amplitude: 7}
amplifier: {peak_current: 1}
plant: {effects: [{name: stribek}]}
"""
    with pytest.raises(ConfigError) as raised:
        parse_yaml(text, "lab.yaml")
    assert str(raised.value).splitlines() == [
        "lab.yaml: encoder.decimation: given twice, on line 3",
        "lab.yaml: servo.rate_hz = 0: must be at least 1 Hz",
        "lab.yaml: servo.prioritty: unknown key; did you mean servo.priority?",
        "lab.yaml: spring.stiffness = soft: must be a number in N m/rad",
        "lab.yaml: plant.effects[0].name = stribek: unknown effect; did you mean stribeck?",
        "lab.yaml: dither.amplitude = 7: must be at most 1 A, amplifier.peak_current",
        "lab.yaml: amplifier.peak_current = 1: must be at least 2 A, amplifier.continuous_current",
    ]


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("{servo: {rate_hz: 0}, dither: {target: position, frequency_hz: 900}}", "servo.rate_hz"),
        ("dither: {target: position, freqency_hz: 50}", "dither.freqency_hz"),
        ("{amplifier: 5, dither: {target: current, waveform: uniform, amplitude: 8}}", "amplifier"),
    ],
)
def test_a_wrong_key_causes_no_second_complaint(text: str, key: str) -> None:
    with pytest.raises(ConfigError) as raised:
        parse_yaml(text, "lab.yaml")
    assert [problem.key for problem in raised.value.problems] == [key]


def test_linear_device_is_told_linear_units() -> None:
    text = "{encoder: {counts_per_metre: 1e5}, plant: {inertia: 0}, safety: {max_velocity: -1}}"
    with pytest.raises(ConfigError) as raised:
        parse_yaml(text, "lab.yaml")
    assert str(raised.value).splitlines() == [
        "lab.yaml: plant.inertia = 0: must be above 0 kg",
        "lab.yaml: safety.max_velocity = -1: must be at least 0 m/s (0 or null: no limit)",
    ]


def test_a_problem_carries_its_parts() -> None:
    with pytest.raises(ConfigError) as raised:
        parse_config({"servo": {"rate_hz": 0, "overrun": {"policy": "skp"}}, "sping": {}}, "request")
    rate, policy, section = raised.value.problems
    assert (rate.file, rate.key, rate.value, rate.limit, rate.unit) == ("request", "servo.rate_hz", "0", 1, "Hz")
    assert (policy.limit, policy.nearest) == (("skip", "hold", "fault"), "skip")
    assert (section.key, section.value, section.nearest) == ("sping", None, "spring")


def test_long_values_are_cut() -> None:
    with pytest.raises(ConfigError) as raised:
        parse_config({"servo": {"rate_hz": "x" * 500}}, "request")
    assert str(raised.value) == f"request: servo.rate_hz = {'x' * 59}…: must be a number in Hz"


def test_socket_path_has_the_length_of_a_socket_path(tmp_path: Path) -> None:
    assert parse_config({"api": {"socket": "/" + "a" * 106}}, "x").api.socket == "/" + "a" * 106
    with pytest.raises(ConfigError, match="is 108 bytes long; a socket's path has at most 107"):
        parse_config({"api": {"socket": "/" + "ä" * 53 + "a"}}, "x")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("delt", "delt: no such file, and no preset of that name; did you mean delta?"),
        ("missing.yaml", "missing.yaml: no such file"),
        ("x" * 256 + ".yaml", "x" * 256 + ".yaml: cannot be read: File name too long"),
        (Path("delta"), "delta: no such file"),
        ("./folder", "./folder: is a directory, not a configuration file"),
        ("latin1.yaml", "latin1.yaml: line 2: not UTF-8 text (byte 0xe4)"),
        ("huge.yaml", "huge.yaml: is larger than 256 KiB; this is not a configuration file"),
        ("loop.yaml", "loop.yaml: cannot be read: Too many levels of symbolic links"),
        ("nul\0.yaml", "'nul\\x00.yaml': cannot be read: embedded null byte"),
    ],
)
def test_unreadable_source(source: str | Path, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    Path("latin1.yaml").write_bytes(b"servo: {}\n# \xe4\n")
    Path("huge.yaml").write_bytes(b"#" * (1 << 20) + b"\n")
    Path("loop.yaml").symlink_to("loop.yaml")
    with pytest.raises(ConfigError) as raised:
        load_config(source)
    assert str(raised.value) == message


def test_a_name_that_is_too_long_for_a_file_is_no_preset_either() -> None:
    with pytest.raises(ConfigError, match="x: no such file, and no preset of that name; presets: re35"):
        load_config("x" * 256)


def test_no_name_at_all_lists_the_presets() -> None:
    with pytest.raises(ConfigError) as raised:
        load_config("")
    assert str(raised.value) == (
        "'': no such file, and no preset of that name; "
        "presets: re35, delta, epos4, freedom6, hapkit, impulse_engine, mit_toolhandle, mj5208, omega, phantom, srv02"
    )


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (130.4, 2, "130"),
        (6049.0, 3, "6050"),
        (99.96, 3, "100"),
        (0.0123, 2, "0.012"),
        (2.5e-6, 2, "2.5e-06"),
        (0.0, 3, "0"),
    ],
)
def test_a_number_of_a_sentence_has_no_exponent_that_a_person_must_work_out(
    value: float, digits: int, text: str
) -> None:
    assert significant(value, digits) == text
