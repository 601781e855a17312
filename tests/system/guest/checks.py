"""What is checked inside the guest, one function a check, in order. Standard library only: it is the guest's own Python.

Every check returns what it found, in words; an exception is a failure and says why. Results go to the second serial port
as one line of JSON each.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

SOURCE = Path("/root/hapticd")
SOCKET = "/run/hapticd/hapticd.sock"
CONFIG = Path("/etc/hapticd/hapticd.yaml")
DRIVE_LOG = Path("/root/drive.arrow")
OUT = Path("/dev/ttyS1").open("w")  # noqa: SIM115 - open for as long as the guest lives
CAN_CONFIG = """\
servo: {rate_hz: 100, overrun: {fault_after: null}}
encoder: {decimation: 217}
safety: {missed_exchanges: 20, heartbeat_timeout_s: 5}
driver: {name: canopen, interface: socketcan, channel: vcan0, profile: copley, watchdog_ms: 1000, reply_timeout_s: 0.008}
"""
GUARD_S = 1.0
checks: list[Callable[[], str]] = []
drive: subprocess.Popen[bytes] | None = None


def check(function: Callable[[], str]) -> Callable[[], str]:
    checks.append(function)
    return function


def sh(command: str, timeout: float = 600.0, ok: tuple[int, ...] = (0,)) -> str:
    """Run a shell command and return its output; its exit code must be one of ``ok``."""
    done = subprocess.run(
        ["bash", "-c", command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=timeout,
        check=False,
    )
    if done.returncode not in ok:
        raise AssertionError(f"{command!r} ended with {done.returncode}: {done.stdout[-600:]}")
    return done.stdout


def status() -> dict[str, Any]:
    return dict(json.loads(sh(f"hapticd status --json --socket {SOCKET} 2>/dev/null", 120)))


def until(condition: Callable[[], Any], what: str, timeout: float = 300.0) -> Any:
    deadline = time.monotonic() + timeout
    while True:
        with contextlib.suppress(AssertionError, subprocess.TimeoutExpired):
            if found := condition():
                return found
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {timeout:g} s in vain for: {what}")
        time.sleep(0.5)


def unit(key: str) -> str:
    return sh(f"systemctl show hapticd -p {key} --value").strip()


def until_active() -> None:
    until(lambda: unit("ActiveState") == "active", "the service to be active")


@check
def kernel() -> str:
    version = sh("uname -v")
    assert "PREEMPT_RT" in version, version
    until(
        lambda: sh("systemctl is-system-running", ok=(0, 1)).strip() in ("running", "starting", "degraded"), "systemd"
    )
    return sh("uname -r").strip() + ", PREEMPT_RT"


@check
def readme() -> str:
    """The newcomer's path in the README, line by line; without a network the dependencies are there, and pip is told so."""
    text = (SOURCE / "README.md").read_text()
    (block,) = re.findall(r"<!-- system test: run as it stands -->\s*```sh\n(.*?)```", text, re.S)
    lines = [line.split("  #")[0].rstrip() for line in block.splitlines() if line.strip()]
    wheel = next((SOURCE / "dist").glob("*.whl"))
    preamble = f'sudo() {{ "$@"; }}; cd {SOURCE}; export WHEEL={wheel} PIP_NO_INDEX=1; '
    for line in lines:
        sh(preamble + line, 1500)
    return f"{len(lines)} lines, ending with the service on the simulated testbed"


@check
def active_and_notified() -> str:
    until_active()
    assert unit("Type") == "notify"
    text = until(lambda: unit("StatusText"), "a status text")
    assert unit("User") == "hapticd"
    found = until(lambda: (s := status())["state"] == "off" and s, "the daemon to answer")
    assert found["timing"]["ticks"] > 0
    threads = sh(f"ps -L -o cls=,rtprio=,comm= -p {unit('MainPID')}")
    assert re.search(r"FF\s+80\s+hapticd-servo", threads), threads
    return f"status text {text!r}, servo thread SCHED_FIFO 80 as user hapticd"


@check
def hardened() -> str:
    sh("systemd-analyze verify hapticd.service hapticd@a.service hapticd-can0.service")
    words = sh("systemd-analyze security --no-pager hapticd.service").splitlines()[-1]
    exposure = float(re.search(r"([0-9.]+)", words.split(":")[1])[1])  # type: ignore[index]
    assert exposure <= 3.0, words
    return f"systemd-analyze security {exposure}"


@check
def metrics_for_node_exporter() -> str:
    """The timer's job: with the daemon, and without it."""
    sh("systemd-analyze verify hapticd-metrics@hapticd.service hapticd-metrics@hapticd.timer")
    prom = Path("/var/lib/prometheus/node-exporter/hapticd.prom")
    prom.parent.mkdir(parents=True, exist_ok=True)
    sh("systemctl enable --now hapticd-metrics@hapticd.timer")
    until(prom.exists, "the first file")
    text = prom.read_text()
    ticks = re.search(r'^hapticd_ticks_total\{testbed="hapticd"\} (\S+)$', text, re.M)
    assert ticks, text[:400]
    assert float(ticks[1]) > 0, ticks[0]
    assert 'hapticd_up{testbed="hapticd"} 1' in text
    sh("systemctl disable --now hapticd-metrics@hapticd.timer; systemctl stop hapticd")
    sh("systemctl start hapticd-metrics@hapticd.service")
    assert prom.read_text().splitlines()[-1] == 'hapticd_up{testbed="hapticd"} 0'
    sh("systemctl start hapticd", 600)
    words = sh("systemd-analyze security --no-pager hapticd-metrics@hapticd.service").splitlines()[-1]
    prom.unlink()
    return f"hapticd_ticks_total {ticks[1]}, then hapticd_up 0; {' '.join(words.split())}"


@check
def udev_rules() -> str:
    group = sh("stat -c %G /dev/cpu_dma_latency").strip()
    assert group == "hapticd", group
    return "/dev/cpu_dma_latency belongs to the group hapticd"


@check
def install_again() -> str:
    before = CONFIG.read_text()
    CONFIG.write_text("# mine\n" + before)
    wheel = next((SOURCE / "dist").glob("*.whl"))
    sh(f"cd {SOURCE} && WHEEL={wheel} PIP_NO_INDEX=1 systemd/install.sh", 900)
    assert CONFIG.read_text().startswith("# mine")
    assert "hapticd run" in sh("man hapticd-run | col -b")
    assert sh("bash -c 'source /usr/local/share/bash-completion/completions/hapticd; complete -p hapticd'")
    return "idempotent, the configuration untouched, completion and manual pages there"


@check
def drive_simulator() -> str:
    global drive
    sh("modprobe vcan && ip link add vcan0 type vcan && ip link set vcan0 up")
    command = ["/opt/hapticd/bin/python", "-m", "sim_hw", "canopen", "--interface", "socketcan", "--channel", "vcan0"]
    out = Path("/root/drive.out").open("wb")  # noqa: SIM115
    drive = subprocess.Popen([*command, "--log", str(DRIVE_LOG)], stdout=out, stderr=out)
    until(lambda: "ready" in Path("/root/drive.out").read_text(), "the drive to be ready", 600)
    return "CiA 402 drive on vcan0"


@check
def service_on_can() -> str:
    CONFIG.write_text(CAN_CONFIG)
    sh("systemctl restart hapticd", 600)
    until_active()
    sh(f"hapticd start --socket {SOCKET}", 120)
    until(lambda: status()["state"] == "running", "running on the drive")
    return "brought up, Operation Enabled"


@check
def frames_on_the_bus() -> str:
    lines = sh("timeout 3 candump -L vcan0", ok=(0, 124)).splitlines()
    frames = [line.split()[2].split("#")[0] for line in lines]
    cycle = [name for name in frames if name in ("080", "181", "201")]
    orders = sum(cycle[i : i + 3] == ["080", "181", "201"] for i in range(len(cycle) - 2))
    assert len(cycle) > 60, lines[:20]
    assert orders > 0.3 * len(cycle), cycle[:30]
    guards = sum(line.split()[2].startswith("701#R") for line in lines)
    assert guards > 0, frames[:30]
    return f"{orders} times SYNC 080, TPDO 181, RPDO 201 in 3 s, {guards} guard requests"


@check
def killed_daemon() -> str:
    """SIGKILL: the drive is at zero current within its guard time, the unit is back, and nothing is armed."""
    restarts = int(unit("NRestarts"))
    struck = time.monotonic_ns()
    sh(f"kill -KILL {unit('MainPID')}")
    until(lambda: int(unit("NRestarts")) > restarts and unit("ActiveState") == "active", "the unit to be back")
    found = until(status, "an answer")
    assert found["state"] in ("off", "fault"), found["state"]
    time.sleep(2)
    script = (
        "import sys, numpy as np; from pathlib import Path; from hapticd.hil.device_log import DeviceLog; "
        f"log = DeviceLog.read(Path('{DRIVE_LOG}')); print(log.zero_current_after({struck}))"
    )
    text = sh(f'/opt/hapticd/bin/python -c "{script}"').strip().splitlines()[-1]
    assert text != "None", "current flows on"
    seconds = (int(text) - struck) * 1e-9
    assert seconds <= GUARD_S + 0.2, f"{seconds:.2f} s"
    return f"zero current after {1e3 * seconds:.0f} ms (guard time {GUARD_S:g} s), restarted, state {found['state']}"


@check
def hung_servo_thread() -> str:
    """The servo thread gets no CPU, everything else lives: the watchdog must notice."""
    until_active()
    until(lambda: status()["timing"]["ticks"] > 0, "ticks")
    restarts = int(unit("NRestarts"))
    pid = unit("MainPID")
    threads = sh(f"ps -L -o tid=,comm= -p {pid}")
    tid = next(line.split()[0] for line in threads.splitlines() if "hapticd-servo" in line)
    sh("sysctl -q kernel.sched_rt_runtime_us=-1")
    hog = subprocess.Popen(["taskset", "-c", "1", "chrt", "-f", "97", "sh", "-c", "while :; do :; done"])
    try:
        sh(f"taskset -p -c 1 {tid}")
        until(lambda: int(unit("NRestarts")) > restarts, "the watchdog to strike", 120)
    finally:
        hog.kill()
    until_active()
    log = sh("journalctl -u hapticd --no-pager -n 200 | grep -i watchdog | tail -1").strip()
    assert "watchdog" in log.lower(), log
    found = until(status, "an answer")
    assert found["state"] in ("off", "fault")
    return f"watchdog, restarted, state {found['state']}"


@check
def reload_good_and_bad() -> str:
    if status()["state"] == "fault":
        sh(f"hapticd clear --socket {SOCKET}", 60)
    CONFIG.write_text(CAN_CONFIG.replace("decimation: 217", "decimation: 434"))
    sh("systemctl reload hapticd")
    digest = until(
        lambda: "434" in sh(f"curl -s --unix-socket {SOCKET} http://h/config || true") or "changed",
        "the new configuration",
    )
    before = until(status, "an answer")["config_digest"]
    CONFIG.write_text("servo: {rate_hz: -5}\n")
    sh("systemctl reload hapticd")
    until(lambda: "reload refused" in sh("journalctl -u hapticd --no-pager -n 50"), "the refusal in the journal")
    assert status()["config_digest"] == before
    CONFIG.write_text(CAN_CONFIG)
    return f"good one in force ({digest and before}), bad one refused, daemon goes on"


@check
def disk_full() -> str:
    sh("mount -t tmpfs -o size=1M,mode=0777 tmpfs /var/lib/hapticd/runs")
    try:
        sh("systemctl restart hapticd", 600)
        until_active()
        sh(f"hapticd start --socket {SOCKET}", 120)
        sh("dd if=/dev/zero of=/var/lib/hapticd/runs/filler bs=64k", ok=(0, 1))
        error = until(lambda: status()["recorder"]["error"], "the recorder's complaint", 180)
        ticks = status()["timing"]["ticks"]
        until(lambda: status()["timing"]["ticks"] > ticks + 50, "the loop to go on")
        assert status()["state"] == "running"
        sh(f"hapticd stop --socket {SOCKET}", 60)
    finally:
        sh("systemctl stop hapticd; umount /var/lib/hapticd/runs", ok=(0, 32))
    return f"the loop goes on; status says: {error}"


@check
def fig_8_over_socketcan() -> str:
    """Cases c and d run at 100 Hz, which this emulation holds; hil starts a drive and a daemon of its own."""
    global drive
    if drive is not None:
        drive.terminate()
        drive.wait(60)
    Path("/root/hil.yaml").write_text(CAN_CONFIG)
    text = sh("cd /root && hapticd hil hil.yaml --only c --only d --json 2>/root/hil.err", 900, ok=(0, 1))
    document = json.loads(text)
    outcomes = {
        case["name"]: (case["outcome"], case["simulated_outcome"], case["problems"]) for case in document["cases"]
    }
    assert outcomes["c"][0] == "decaying", outcomes
    assert outcomes["d"][0] == "growing", outcomes
    latency = document["latency"]
    return f"c decays, d grows, as simulated; sample to current {latency['p50_us']:.0f} µs median"


@check
def clean_stop() -> str:
    CONFIG.write_text("driver: {name: loopback}\n")
    sh("systemctl restart hapticd", 600)
    until_active()
    sh("systemctl stop hapticd", 60)
    assert unit("Result") == "success", unit("Result")
    assert not Path(SOCKET).exists()
    return "stopped, the socket is gone"


@check
def uninstall() -> str:
    sh(f"cd {SOURCE} && systemd/install.sh uninstall")
    left = sh(
        "find / -xdev \\( -path /proc -o -path /sys -o -path /root -o -path /etc/hapticd -o -path /var/lib/hapticd "
        "-o -path /var/log -o -path /tmp -o -path /run \\) -prune -o -iname '*hapticd*' -print"
    ).split()
    left = [path for path in left if "hapticd-system-test" not in path]
    assert not left, left
    assert CONFIG.exists()
    return "nothing left but /etc/hapticd and /var/lib/hapticd"


def main() -> None:
    only = json.loads((SOURCE / "tests/system/guest/only.json").read_text())
    os.environ["HOME"] = "/root"
    for function in checks:
        if only and function.__name__ not in only:
            continue
        begin = time.monotonic()
        try:
            detail, ok = function(), True
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            detail, ok = f"{type(error).__name__}: {error}", False
        seconds = round(time.monotonic() - begin, 1)
        line = {"name": function.__name__, "ok": ok, "detail": " ".join(detail.split())[:800], "seconds": seconds}
        print(json.dumps(line), file=OUT, flush=True)
    print(json.dumps({"name": "end", "ok": True, "detail": "", "seconds": 0}), file=OUT, flush=True)


if __name__ == "__main__":
    main()
