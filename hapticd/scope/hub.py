"""From one daemon to all pages: frames relayed as they are, and the state.

With no page open, nothing runs here and nothing is asked of the daemon. To ask for the state wakes threads of two
processes: it is done at once when a frame says that the loop has another one, or when a page has commanded something, and
twice a second besides. Every page has bounded queues of its own that drop their oldest entry; rows and state go over two
connections, so that bulk data in a slow network's buffers never stands in front of the state.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from prometheus_client.parser import text_string_to_metric_families

from hapticd.client import Client, DaemonUnreachable, RequestRefused
from hapticd.record import frames as coding
from hapticd.scope import theory
from hapticd.scope._upstream import StreamLost, frames

log = logging.getLogger(__name__)

STATE_S = 0.5
SOONEST_S = 0.1
"""From one look at the state to the next, though everything changes all the time."""
HISTOGRAMS_S = 2.0
RETRY_S = 0.5
WAITING_FRAMES = 32
WAITING_MESSAGES = 16
ASK_TIMEOUT_S = 5.0
Item = TypeVar("Item")


def put(queue: asyncio.Queue[Item], item: Item) -> None:
    """Put an item into a page's queue, which drops its oldest one where it is full; never waits."""
    if queue.full():
        queue.get_nowait()
    queue.put_nowait(item)


class Hub:
    """What all pages share.

    Args:
        socket_path: the daemon's.
    """

    def __init__(self, socket_path: Path) -> None:
        self.socket_path = socket_path
        self.client = Client(socket_path, ASK_TIMEOUT_S)
        self.rows: set[asyncio.Queue[bytes]] = set()
        self.states: set[asyncio.Queue[dict[str, Any]]] = set()
        self.config: dict[str, Any] | None = None
        """The newest ``config`` message; None while no daemon has answered."""
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="scope-state")
        self._relay: asyncio.Task[None] | None = None
        self._poll: asyncio.Task[None] | None = None
        self._version: tuple[Any, ...] | None = None
        self._changed = asyncio.Event()

    def look_again(self) -> None:
        """Ask for the state now: something has changed."""
        self._changed.set()

    def watch_rows(self) -> asyncio.Queue[bytes]:
        """A new page's queue of frames."""
        queue: asyncio.Queue[bytes] = asyncio.Queue(WAITING_FRAMES)
        self.rows.add(queue)
        if self._relay is None:
            self._relay = asyncio.create_task(self._run_relay())
        return queue

    def watch_state(self) -> asyncio.Queue[dict[str, Any]]:
        """A new page's queue of messages."""
        queue: asyncio.Queue[dict[str, Any]] = asyncio.Queue(WAITING_MESSAGES)
        self.states.add(queue)
        if self._poll is None:
            self._poll = asyncio.create_task(self._run_poll())
        if self.config is not None:
            put(queue, self.config)
        return queue

    def leave_rows(self, queue: asyncio.Queue[bytes]) -> None:
        """A page has gone; the daemon's stream is let go with the last one."""
        self.rows.discard(queue)
        if not self.rows and self._relay is not None:
            self._relay.cancel()
            self._relay = None

    def leave_state(self, queue: asyncio.Queue[dict[str, Any]]) -> None:
        """A page has gone; nothing is asked any more after the last one."""
        self.states.discard(queue)
        if not self.states and self._poll is not None:
            self._poll.cancel()
            self._poll = None
            self.config, self._version = None, None

    def close(self) -> None:
        """Let the threads go."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    async def ask(self, method: Callable[..., Any], *arguments: Any) -> Any:
        """Call something that waits, on the hub's own thread."""
        return await asyncio.get_running_loop().run_in_executor(self._pool, method, *arguments)

    async def _run_relay(self) -> None:
        standing: tuple[int, int] | None = None
        while True:
            try:
                async for frame in frames(self.socket_path):
                    if (now := coding.standing(frame)) not in (None, standing):
                        standing = now
                        self.look_again()
                    for queue in self.rows:
                        put(queue, frame)
            except StreamLost as lost:
                log.debug("%s", lost)
            await asyncio.sleep(RETRY_S)

    async def _run_poll(self) -> None:
        histograms_due = 0.0
        while True:
            began = time.monotonic()
            self._changed.clear()
            message: dict[str, Any] = {"type": "state", "status": None, "why": None}
            try:
                message["status"] = status = await self.ask(self.client.status)
                version = (status["config_digest"], status["origin_counts"], status["settings_epoch"])
                if version != self._version:
                    self.config = await self.ask(self._describe, status["latency_s"])
                    self._version = version
                    self._send(self.config)
                if began >= histograms_due:
                    histograms_due = began + HISTOGRAMS_S
                    self._send({"type": "histograms", **await self.ask(self._histograms)})
            except (DaemonUnreachable, RequestRefused) as error:
                message["why"] = str(error)
            except Exception:
                log.exception("the state could not be worked out")
                message["why"] = "the scope failed inside itself; its log has the details"
            self._send({**message, "unix_s": time.time()})
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(STATE_S):
                    await self._changed.wait()
            await asyncio.sleep(began + SOONEST_S - time.monotonic())

    def _describe(self, latency_s: float) -> dict[str, Any]:
        return {"type": "config", **theory.describe(self.client.config(), latency_s)}

    def _histograms(self) -> dict[str, Any]:
        """Lateness and execution time since the loop began: upper bounds in s and how many ticks lie below each."""
        found: dict[str, Any] = {}
        for family in text_string_to_metric_families(self.client.metrics()):
            if family.type == "histogram":
                buckets = [sample for sample in family.samples if sample.name.endswith("_bucket")]
                below = [(float(sample.labels["le"]), sample.value) for sample in buckets]
                name = family.name.removeprefix("hapticd_").removesuffix("_seconds")
                found[name] = {"bounds_s": [bound for bound, _ in below], "below": [count for _, count in below]}
        return found

    def _send(self, message: dict[str, Any]) -> None:
        for queue in self.states:
            put(queue, message)
