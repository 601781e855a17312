"""Client of the control API over its Unix socket, for the command line and other programs.

>>> from hapticd.client import Client
>>> client = Client("/run/hapticd/hapticd.sock")
>>> client.set({"spring.stiffness": 0.012})  # doctest: +SKIP
>>> client.start()  # doctest: +SKIP
"""

from hapticd.client._recordings import find_run, recording_folders
from hapticd.client.client import (
    Client,
    DaemonUnreachable,
    RequestRefused,
    StoppedUnanswered,
    settings_for_a_while,
    stop_on_interrupt,
)

__all__ = [
    "Client",
    "DaemonUnreachable",
    "RequestRefused",
    "StoppedUnanswered",
    "find_run",
    "recording_folders",
    "settings_for_a_while",
    "stop_on_interrupt",
]
