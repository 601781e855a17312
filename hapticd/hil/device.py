"""The simulated device as a child process: which one the config asks for, and where the daemon finds it."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import yaml

from hapticd.config import Config, config_to_yaml
from hapticd.hil.device_log import DeviceLog
from hapticd.hil.errors import HilError
from hapticd.hil.process import Child

DEFAULT_BAUD = 921_600
READY_TIMEOUT_S = 120.0
"""The first start on a machine compiles the device's loop."""
SYS_CLASS_NET = Path("/sys/class/net")


class Device(Child):
    """Simulated hardware for a config's driver.

    Args:
        config: names the driver and its options; ``serial_dac`` or ``canopen``.
        folder: takes plant file, script, log and output.
        plant: the device's own plant, which the daemon does not see; None: the config's.
        script: hand forces and faults to play (``docs/reference/simulated-hardware.md``).
        board: the reference firmware as a binary on this board in place of the simulated one.
        log: whether it writes down what happens; in an hour that is half a gigabyte.

    Raises:
        HilError: the config's driver has no simulated device.
    """

    def __init__(
        self,
        config: Config,
        folder: Path,
        *,
        plant: Config | None = None,
        script: dict[str, Any] | None = None,
        board: str | None = None,
        log: bool = True,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.log_path = folder / "device.arrow"
        self.options: dict[str, Any] = {}
        """Driver options that lead the daemon to this device."""
        plant_file, script_file = folder / "plant.yaml", folder / "script.yaml"
        plant_file.write_text(config_to_yaml(plant or config))
        script_file.write_text(yaml.safe_dump(script or {}))
        common = ["--plant", str(plant_file), "--script", str(script_file)]
        if log:
            common += ["--log", str(self.log_path)]
        address = self._address(config, folder, board)
        super().__init__(
            "the simulated device", [sys.executable, "-m", "sim_hw", *address, *common], folder / "device.out"
        )

    def _address(self, config: Config, folder: Path, board: str | None) -> list[str]:
        options = config.driver.options
        if config.driver.name == "serial_dac":
            link = folder / "tty"
            self.options = {"port": str(link)}
            if board is not None:
                return ["firmware", "--board", board, "--link", str(link)]
            # A pseudo-terminal is as fast as memory; the board lets its bytes take the time they would on the line.
            return ["serial", "--link", str(link), "--line-baud", str(options.get("baud", DEFAULT_BAUD))]
        if config.driver.name == "canopen":
            node = ["--node-id", str(options.get("node_id", 1))]
            interface, channel = options.get("interface", "socketcan"), str(options.get("channel", "can0"))
            if interface != "unix_seqpacket":
                _check_no_real_bus(interface, channel)
                return ["canopen", "--interface", interface, "--channel", channel, *node, *_bus_arguments(config)]
            path = folder / "can.sock"
            self.options = {"channel": str(path)}
            return ["canopen", "--socket", str(path), *node]
        raise HilError(
            f"driver.name = {config.driver.name!r}: has no simulated hardware in a process of its own; "
            "hil needs serial_dac or canopen"
        )

    def wait_ready(self) -> None:
        """Wait for its ready line.

        Raises:
            HilError: it ended, or did not come up in time.
        """
        self.wait_until(self._is_ready, "it was ready", READY_TIMEOUT_S)

    def _is_ready(self) -> bool:
        for line in self.log.read_text(errors="replace").splitlines():
            if line.startswith("{"):
                return bool(json.loads(line).get("ready"))
        return False

    def read_log(self) -> DeviceLog:
        """What the device wrote down; complete once it has ended."""
        return DeviceLog.read(self.log_path)


def _bus_arguments(config: Config) -> list[str]:
    """``driver.bus`` for the device too, where python-can serves it: both ends must be on the same bus."""
    options = config.driver.options
    if options.get("interface", "socketcan") == "socketcan":
        return []  # the device opens the kernel's socket itself; arguments of python-can are the daemon's affair
    given = options.get("bus") or {}
    if not isinstance(given, dict):
        raise HilError(f"driver.bus = {given!r}: must be a mapping of arguments for the python-can interface")
    return [word for name, value in given.items() for word in ("--bus", f"{name}={json.dumps(value)}")]


def _check_no_real_bus(interface: str, channel: str) -> None:
    """A drive on a real bus would hear the daemon too, and move.

    Raises:
        HilError: the interface is neither between processes nor a virtual one of the kernel.
    """
    if interface == "udp_multicast":
        return
    named_virtual = interface == "socketcan" and channel.startswith(("vcan", "vxcan"))
    if not (named_virtual and "virtual" in (SYS_CLASS_NET / channel).resolve().parts):
        raise HilError(
            f"driver.interface = {interface!r}, driver.channel = {channel!r}: a real drive may be there, and the "
            "daemon would move it; hil needs --set driver.interface=unix_seqpacket, or udp_multicast, or socketcan on a "
            "virtual interface that is up (vcan, vxcan)"
        )
