"""``hapticd run`` at a terminal: a banner with device and real-time properties, a live line, a summary.

Without a terminal the same facts go to the log: the banner once, then one line for every change of state.
"""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path
from socket import SOCK_DGRAM
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.live import Live
from rich.logging import RichHandler
from rich.text import Text

from drivers import DriverConfigError
from hapticd.config import ConfigError
from hapticd.config.limits import limits_text
from hapticd.control import descriptors
from hapticd.control.fault_text import fault_lines
from hapticd.record.files import why_unwritable
from hapticd.service import checks
from hapticd.service._signals import Signals
from hapticd.service.access import Rules
from hapticd.service.api import ApiServer
from hapticd.service.daemon import Daemon, source_name
from hapticd.service.flight import crash_log, flight_directory, recover
from hapticd.service.journal import JournalHandler, stderr_is_journal
from hapticd.service.latch import FaultLatch, is_service
from hapticd.service.notify import Notifier
from hapticd.service.refusals import DriverFailure, Refused
from hapticd.service.socket import SocketError, bind, claim, group_id, stop_path
from hapticd.servo.authority import Withdrawn
from hapticd.stability import regions

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.service.sink import Sink

log = logging.getLogger(__name__)

EXIT_OK = 0
EXIT_FAULT = 5


def banner(daemon: Daemon, socket: Path, source: str, *, starting: bool = False) -> list[str]:
    """The lines of the banner: what a user must know before touching the handle.

    Args:
        daemon: the daemon. socket: its path. source: file or preset of its config.
        starting: whether the spring will be rendered at once.
    """
    rig = daemon.rig
    config = rig.config
    unit = "m" if config.is_linear else "rad"
    status = daemon.status()
    point = status["operating_point"]
    meaning = regions.MEANING[point["region"]]
    per = "m" if config.is_linear else "rev"
    counts = config.encoder.counts_per_metre if config.is_linear else config.encoder.counts_per_rev
    lines = [
        f"device      {rig.driver.describe()}",
        f"config      {source}, digest {status['config_digest']}",
        f"servo       {config.servo.rate_hz:g} Hz, overrun policy {config.servo.overrun.policy}",
        f"encoder     {counts:g} counts/{per}, decimation {config.encoder.decimation}: "
        f"one coarse tick is {config.resolution:.4g} {unit}",
        f"operating   μ {_number(point['mu'])}  β {_number(point['beta'])}  σ {_number(point['sigma'])}  "
        f"τ_D {_number(point['tau_d'])}",
        f"            region {point['region']}: {meaning}",
    ]
    for grant in rig.grants:
        lines.append(f"real time   {'yes' if grant.granted else 'NO '} {grant.name}: {grant.detail}")
        if not grant.granted:
            lines.append(f"            to get it: {grant.fix}")
    if rig.driver.calls_python:
        lines.append(
            "WARNING     this driver runs Python code inside the tick: fine for bring-up, late whenever the GIL is busy"
        )
    lines.append(f"socket      {socket}")
    lines.append(f"recordings  {rig.recorder.directory}" + ("" if config.record.enabled else " (only on request)"))
    if why := why_unwritable(rig.recorder.directory):
        lines.append(f"WARNING     no run can be recorded: {why}; record.directory names the folder")
    if why := latch_unwritable(FaultLatch(socket).path):
        lines.append(f"WARNING     {why}")
    if status["limits_off"]:
        lines.append(f"WARNING     limits that are {limits_text(status['limits_off'])}")
    if status["fault"]:
        lines += [f"FAULT       {line}" for line in fault_lines(status["fault"])]
    elif starting:
        lines.append("motor       on in a moment, as --start asks: keep clear; 'hapticd stop' or Ctrl-C ends it")
    else:
        lines.append(
            "motor       off, zero current; 'hapticd start' renders the spring, 'hapticd release' runs Fig. 8; Ctrl-C ends"
        )
    return lines


def latch_unwritable(path: Path) -> str | None:
    """Why a fault would be lost at a restart, and what to do; None if it would not.

    Args:
        path: file of the latched fault.
    """
    if why := why_unwritable(path.parent):
        mend = "make that folder writable" + ("" if is_service() else ", or name another one in $XDG_STATE_HOME")
        return f"a fault would not outlive a restart: {path} cannot be written, {why}; {mend}"
    return None


def _number(value: float | None) -> str:
    """A dimensionless number as text; None in the status means infinite, as without a spring."""
    return "∞" if value is None else f"{value:.4g}"


def live_line(status: dict[str, Any]) -> str:
    """The present state in one line."""
    timing, recorder = status["timing"], status["recorder"]
    late = timing["wake_us"]
    late_text = f"late p50 {late['p50']:.0f} max {late['max']:.0f} µs" if late["p50"] is not None else "late -"
    line = (
        f"{status['state']:<8}{status['position_ticks']:+12.3f} ticks {status['current']:+7.3f} A  "
        f"{timing['ticks']} ticks, missed {timing['missed']}, {late_text}"
    )
    if recorder["path"]:
        line += f"  rec {recorder['rows']} rows" + (f" ({recorder['dropped']} dropped)" if recorder["dropped"] else "")
    if recorder["error"]:
        line += f"  {recorder['error']}"
    if status["fault"]:
        line = f"FAULT {status['fault']['code']}: {status['fault']['cause']}  ({status['fault']['help']})"
    return line


def summary(status: dict[str, Any]) -> list[str]:
    """The lines that are printed at the end."""
    timing = status["timing"]

    def quantiles(name: str) -> str:
        values = timing[name]
        if values["p50"] is None:
            return "-"
        return (
            f"p50 {values['p50']:.1f}  p99 {values['p99']:.1f}  p99.9 {values['p999']:.1f}  max {values['max']:.1f} µs"
        )

    return [
        f"ticks       {timing['ticks']}, missed periods {timing['missed']}, missed exchanges {status['exchanges_missed']}",
        f"late        {quantiles('wake_us')}",
        f"execution   {quantiles('exec_us')}",
        f"recorded    {status['recorder']['rows_total']} rows, {status['recorder']['dropped_total']} dropped",
    ]


def _state_line(status: dict[str, Any]) -> str:
    """The text for ``systemctl status``; it changes only with the state."""
    fault = status["fault"]
    if fault:
        return f"fault {fault['code']}: {fault['cause']}"
    return f"{status['state']}, {status['timing']['rate_hz']:g} Hz"


def run_foreground(
    config: Config,
    *,
    sink: Sink,
    source: str | None = None,
    socket: Path | None = None,
    autostart: bool = False,
    force: bool = False,
    quiet: bool = False,
) -> int:
    """Run the daemon until a signal ends it, with zero current and the amplifier off.

    Args:
        sink: writes all output.
        source: file or preset of the config, for a reload. socket: instead of the config's.
        autostart: start to render at once. force: even if the guard refuses.
        quiet: no banner, no live line, no summary; warnings only.

    Returns:
        0, or 5 if it ended with a latched fault.

    Raises:
        DriverError, RealtimeError: the rig cannot be started. SocketError: the socket cannot be created, or another daemon
            has replaced this one.
    """
    console = Console(file=sink.stream, quiet=quiet)
    log_to(console, sink)
    signals = Signals()
    descriptors.prepare()
    path = socket or Path(config.api.socket)
    console.print(
        "starting (the first start compiles the servo loop, about ten seconds) …", style="dim", highlight=False
    )
    # The claim comes first: only its holder may open the device. The sockets come last, when all threads exist.
    rules, mode = _access(config)
    with contextlib.ExitStack() as ending:
        notifier = Notifier.from_environment()
        ending.callback(notifier.close)
        claimed = claim(path)
        ending.callback(claimed.release)
        latch = FaultLatch(path)
        _recover(config, latch.name)
        try:
            daemon = Daemon(config, source, latch, notifier, lambda: sink.dropped)
        except DriverConfigError as error:
            raise DriverConfigError(f"{source}: {error}" if source else str(error)) from error
        ending.callback(daemon.shutdown)
        signals.halt_with(daemon.authority.end, daemon.authority.stop)
        server = ApiServer(daemon, rules=rules)
        ending.callback(server.stop)
        ending.enter_context(crash_log(config, latch.name))
        stop_channel = bind(stop_path(path), int(config.api.mode, 8), config.api.group, SOCK_DGRAM)
        ending.callback(stop_channel.close)
        bound = bind(path, mode, config.api.group, claimed=claimed)
        # They are closed in reverse order.
        for step in (bound.close, server.stop, daemon.disable, notifier.stopping):
            ending.callback(step)
        daemon.stop_channel.listen(stop_channel.socket)
        server.start(bound)
        alive = {"hapticd-api": server.alive, "hapticd-sink": sink.alive}
        daemon.self_check.add("service_threads", checks.threads(lambda: {name: ask() for name, ask in alive.items()}))
        sockets = [(bound, server.listen_on), (stop_channel, daemon.stop_channel.listen)]
        daemon.self_check.add("socket", checks.SocketCheck(sockets, daemon.authority.stop, daemon.supersede))
        daemon.self_check.add("latch", checks.latch(lambda: latch_unwritable(latch.path)), slow=True)
        for line in banner(daemon, path, source_name(source), starting=autostart):
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        if autostart and not signals.ending:
            try:
                daemon.start(force)
            except (Refused, Withdrawn, DriverFailure) as error:
                log.error("cannot start: %s", error)
        notifier.ready()
        _watch(daemon, signals, console, notifier, sink)
    status = daemon.status()
    for line in summary(status):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if daemon.superseded is not None:
        raise SocketError(f"{daemon.superseded}; this one has switched its motor off and ended")
    return EXIT_FAULT if status["fault"] else EXIT_OK


def _access(config: Config) -> tuple[Rules, int]:
    """Roles of the callers, and the mode of the socket's file."""
    if config.api.watch_group is None:
        return Rules(), int(config.api.mode, 8)
    # A file has only one group, so everybody may connect, and the caller's groups are checked then.
    watch = group_id(config.api.watch_group, "api.watch_group")
    return Rules(group_id(config.api.group, "api.group"), watch), 0o666


def _recover(config: Config, name: str) -> None:
    """Recover the flight recorder of a daemon that was killed on this socket."""
    directory = flight_directory(config)
    for found in recover(directory, name) if directory else ():
        log.warning("%s; its last %d rows are in %s", found.reason, found.rows, found.run)


def log_to(console: Console, sink: Sink) -> None:
    """Write the log to a sink: warnings alone on a quiet console."""
    level = logging.WARNING if console.quiet else logging.INFO
    handler: logging.Handler = logging.StreamHandler(sink.stream)
    text = "%(levelname)s %(message)s"
    if console.is_terminal:
        # With a quiet console the log is still printed.
        console = Console(file=sink.stream) if console.quiet else console
        handler, text = RichHandler(console=console, show_path=False, markup=False), "%(message)s"
    elif stderr_is_journal():
        handler, text = JournalHandler(sink), "%(message)s"
    logging.basicConfig(level=level, format=text, handlers=[handler])


def _watch(daemon: Daemon, signals: Signals, console: Console, notifier: Notifier, sink: Sink) -> None:
    """Show the state until a signal ends the daemon; without a terminal, SIGHUP reloads the config."""
    shown = asked = None
    off: list[str] = []
    with Live(console=console, auto_refresh=False, transient=True) as live:
        while asked != "end" and not daemon.dead:
            asked = signals.wait(0.2)
            if asked == "reload":
                notifier.reloading()
                try:
                    daemon.reload(None)
                except (ConfigError, Refused, DriverFailure) as error:
                    log.error("reload refused, the old configuration stays in force: %s", error)
                notifier.ready()
            status = daemon.status()
            notifier.status(_state_line(status))
            if console.is_terminal:
                # No live line for a terminal that has not accepted the earlier output.
                if not sink.behind:
                    live.update(Text(live_line(status), overflow="ellipsis", no_wrap=True), refresh=True)
            elif status["state"] != shown:
                log.info("state %s", status["state"])
            if status["limits_off"] != off and (off := status["limits_off"]):
                log.warning("limits that are %s", limits_text(off))
            shown = status["state"]
