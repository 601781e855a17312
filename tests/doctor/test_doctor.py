"""The doctor on made-up machines: what it finds, whether that matters at the rate, and the way out."""

from __future__ import annotations

import json
import platform
from pathlib import Path

import pytest

from hapticd.cli.main import main
from hapticd.config import Config, apply_settings, load_config
from hapticd.doctor import Finding, Level, Machine
from hapticd.doctor.device import device
from hapticd.doctor.finding import cpu_list
from hapticd.doctor.kernel import clock_source, group_scheduling, preemption, throttling, virtual_machine
from hapticd.doctor.processors import governor, hyper_threading, idle_states, interrupts, isolation


def machine(root: Path, **files: str) -> Machine:
    """A machine of these files; ``__`` in a name is a slash."""
    for name, text in files.items():
        path = root / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")
    return Machine(root)


def config(**settings: object) -> Config:
    dotted = {key.replace("__", "."): value for key, value in settings.items()}
    return apply_settings(load_config(None), dotted) if dotted else load_config(None)


def on(driver: str, **options: object) -> Config:
    base = load_config(None)
    return base.model_copy(update={"driver": type(base.driver)(name=driver, **options)})


def test_an_ordinary_kernel_matters_only_to_a_fast_loop(tmp_path: Path) -> None:
    ordinary = machine(tmp_path, proc__version="Linux version 6.1 #1 SMP PREEMPT_DYNAMIC Debian")
    assert preemption(ordinary, config(servo__rate_hz=100)).level is Level.GOOD
    at_1_khz = preemption(ordinary, config())
    assert at_1_khz.level is Level.NOTE
    assert "linux-image-rt" in at_1_khz.fix


def test_preempt_rt_is_found_both_ways(tmp_path: Path) -> None:
    assert preemption(machine(tmp_path / "a", sys__kernel__realtime="1"), config()).found == "PREEMPT_RT"
    named = machine(tmp_path / "b", proc__version="Linux version 6.12 #1 SMP PREEMPT_RT Debian")
    assert preemption(named, config()).level is Level.GOOD


@pytest.mark.parametrize(("runtime", "level"), [("-1", Level.GOOD), ("950000", Level.GOOD), ("100000", Level.BAD)])
def test_throttling(runtime: str, level: Level, tmp_path: Path) -> None:
    assert throttling(machine(tmp_path, proc__sys__kernel__sched_rt_runtime_us=runtime), config()).level is level


def test_group_scheduling_is_unfit(tmp_path: Path) -> None:
    name = f"boot__config-{platform.release()}"
    assert group_scheduling(machine(tmp_path / "a", **{name: "CONFIG_RT_GROUP_SCHED=y"}), config()).level is Level.BAD
    off = machine(tmp_path / "b", **{name: "# CONFIG_RT_GROUP_SCHED is not set"})
    assert group_scheduling(off, config()).level is Level.GOOD


def test_a_slow_clock_and_a_virtual_machine_are_noted(tmp_path: Path) -> None:
    files = {"sys__devices__system__clocksource__clocksource0__current_clocksource": "hpet"}
    slow = machine(tmp_path, **files, proc__cpuinfo="flags : fpu hypervisor")
    assert clock_source(slow, config()).level is Level.NOTE
    assert virtual_machine(slow, config()).level is Level.NOTE


def test_processors(tmp_path: Path) -> None:
    cpus = "sys__devices__system__cpu"
    found = machine(
        tmp_path,
        **{
            f"{cpus}__cpu0__cpufreq__scaling_governor": "powersave",
            f"{cpus}__cpu0__cpuidle__state2__latency": "133",
            f"{cpus}__smt__active": "1",
            f"{cpus}__isolated": "2-3",
            f"{cpus}__online": "0-3",
            "proc__irq__17__smp_affinity_list": "0-3",
            "proc__irq__18__smp_affinity_list": "0",
        },
    )
    assert governor(found, config()).fix == "cpupower frequency-set -g performance"
    idle = idle_states(found, config())
    assert idle.level is Level.NOTE
    assert "13 % of a period" in idle.matters
    assert hyper_threading(found, config()).level is Level.NOTE
    assert isolation(found, config(servo__cpu=3)).level is Level.GOOD
    assert "isolcpus=1" in isolation(found, config(servo__cpu=1)).fix
    assert isolation(found, config(servo__cpu=9)).level is Level.BAD
    struck = interrupts(found, config(servo__cpu=3))
    assert struck.found.startswith("1 may be handled")
    assert "echo 0,1,2 > /proc/irq/$i" in struck.fix


@pytest.mark.parametrize(
    ("text", "cpus"), [("0-2,5", {0, 1, 2, 5}), ("", set()), (None, set()), ("x", set()), ("7", {7})]
)
def test_cpu_lists(text: str | None, cpus: set[int]) -> None:
    assert cpu_list(text) == cpus


def levels(findings: list[Finding]) -> dict[str, Level]:
    return {finding.name: finding.level for finding in findings}


def test_a_latency_timer_of_many_periods_is_unfit(tmp_path: Path) -> None:
    found = machine(tmp_path, **{"sys__bus__usb-serial__devices__null__latency_timer": "16"})
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev" / "ttyUSB0").symlink_to("/dev/null")  # a character device that every machine has
    findings = list(device(found, on("serial_dac", port="/dev/ttyUSB0")))
    assert levels(findings) == {"serial port": Level.GOOD, "latency timer": Level.BAD}
    assert "16 periods" in findings[1].matters
    missing = list(device(found, on("serial_dac", port="/dev/ttyUSB7")))
    assert levels(missing) == {"serial port": Level.BAD}


@pytest.mark.parametrize("port", ["/home/me/notes.txt", "/home/me"])
def test_a_file_or_folder_as_port_is_unfit(tmp_path: Path, port: str) -> None:
    (finding,) = device(machine(tmp_path, **{"home__me__notes.txt": ""}), on("serial_dac", port=port))
    assert (finding.level, finding.found) == (Level.BAD, f"driver.port = {port!r} is a file or folder, no serial port")


def test_a_can_interface_that_is_down_or_not_there(tmp_path: Path) -> None:
    found = machine(tmp_path, sys__class__net__can7__ifindex="3", sys__class__net__can7__operstate="down")
    (down,) = device(found, on("canopen", interface="socketcan", channel="can7", bitrate=500_000))
    assert down.level is Level.BAD
    assert "bitrate 500000" in down.fix
    (absent,) = device(found, on("canopen", interface="socketcan", channel="can9"))
    assert "does not exist" in absent.found


def test_the_command_says_no_with_its_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["doctor", "--set", "driver.name=canopen", "--json"])
    document = json.loads(capsys.readouterr().out)
    assert code == 1
    assert document["fit"] is False
    assert "can interface" in document["verdict"]
    names = {finding["name"] for finding in document["findings"]}
    assert {"preemption", "memory lock", "clock source", "recordings", "compiled code"} <= names
