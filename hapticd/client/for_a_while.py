"""Live settings that hold for one experiment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from hapticd.client.client import Client


@contextmanager
def settings_for_a_while(client: Client, settings: Mapping[str, Any], force: bool = False) -> Iterator[None]:
    """Apply live settings, and take them back at the end, however it comes.

    Args:
        client: the daemon.
        settings: dotted key to value; nothing is asked of the daemon where there is none.
        force: override the stability guard. What was in force before comes back in any case.

    Raises:
        RequestRefused: the daemon does not take them; none is in force then.
    """
    if not settings:
        yield
        return
    config = client.config()
    before = {key: _value(config, key) for key in settings}
    client.set(dict(settings), force)
    try:
        yield
    finally:
        client.set(before, force=True)


def _value(config: Mapping[str, Any], key: str) -> Any:
    value: Any = config
    for part in key.split("."):
        value = value[part]
    return value
