import contextlib
import json
import signal

import pytest
import yaml

from sim_hw.log import read_log
from tests import forked
from tests.sim_hw.canopen.master import Master


class DriveProcess:
    """What ``python -m sim_hw canopen`` runs, in a process of its own, on a Unix socket."""

    def __init__(self, folder, *options, script=None, plant=None, bus=None):
        self.folder = folder
        self.stderr = None
        self.socket, self.log = folder / "can", folder / "drive.arrow"
        arguments = ["canopen", "--log", str(self.log), *map(str, options)]
        arguments += bus if bus is not None else ["--socket", str(self.socket)]
        for name, content in (("script", script), ("plant", plant)):
            if content is not None:
                path = folder / f"{name}.yaml"
                path.write_text(yaml.safe_dump(content))
                arguments += [f"--{name}", str(path)]
        self.process = forked.device(arguments, folder)
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(self.process.communicate()[1])
        self.ready = json.loads(line)

    def stop(self, number=signal.SIGTERM):
        """End it by a signal; the log's rows."""
        if self.stderr is None:
            self.process.send_signal(number)
            _, self.stderr = self.process.communicate(timeout=60)
            self.returncode = self.process.returncode
        return read_log(self.log)


@pytest.fixture
def start_drive(tmp_path):
    """Starts drives and masters; all of them end with the test."""
    with contextlib.ExitStack() as stack:

        def start(*options, node=1, **keywords):
            drive = DriveProcess(tmp_path, *options, **keywords)
            stack.callback(drive.stop)
            master = None
            if drive.socket.exists():
                master = Master(drive.socket, node)
                stack.callback(master.close)
            return drive, master

        yield start
