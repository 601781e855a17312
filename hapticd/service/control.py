"""What the control API may ask of the daemon: one Protocol and the exceptions that are answers.

Everything here is plain standard library, so that the API, the command line and a test's stand-in can share it without
starting anything. The daemon (``hapticd.service.daemon``) satisfies :class:`Control`. The API calls it from several
threads at once, :meth:`Control.estop` above all, which must therefore never wait for a lock that another method holds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from hapticd.service.live import LiveStream

JsonDict = dict[str, Any]


class Control(Protocol):
    """The daemon as the API sees it. Every method may be called from any thread and returns JSON-ready values."""

    live: LiveStream
    """The rows as they come, for whoever looks."""

    def status(self) -> JsonDict:
        """State, fault, timing, operating point, position, recorder and experiment (``hapticd status --json``)."""

    def config(self) -> JsonDict:
        """The config in force, section by section, as ``hapticd config show --json`` prints it."""

    def metrics(self) -> bytes:
        """The daemon's numbers in Prometheus' text format 0.0.4."""

    def start(self, force: bool = False) -> JsonDict:
        """Enable the amplifier and render the spring. Returns the status, and what the guard says as ``guard``.

        Args:
            force: render a spring that the guard refuses (``hapticd.stability.guard``).

        Raises:
            Refused: a fault is latched, an experiment is being torn down, or (``unstable``) the motion would not die out.
            DriverFailure: the device cannot be opened or enabled.
        """

    def stop(self) -> JsonDict:
        """Zero current, then disable; ends a running experiment. Returns the status.

        Called on a thread of its own: it must not wait behind a release that is looking for a shaft at rest.
        """

    def estop(self) -> JsonDict:
        """Zero current at once, disable, latch the fault ``estop``. Takes no lock. Returns the status."""

    def clear(self) -> JsonDict:
        """Clear a latched fault. Returns the status.

        Raises:
            Refused: the cause of the fault is still there.
        """

    def set(self, settings: dict[str, Any], force: bool = False) -> JsonDict:
        """Change live settings, all or none. Returns ``{"applied": {key: value, …}, "config_digest": str, "guard": …}``.

        Args:
            settings: dotted key to value; a string is read as a YAML scalar, as on the command line.
            force: as in :meth:`start`.

        Raises:
            ConfigError: unknown key or bad value.
            Refused: code ``restart_needed``, a key that cannot change while the daemon runs; ``unstable``, as in
                :meth:`start`. Nothing has changed then.
        """

    def release(self, deflection: float, duration_s: float | None, force: bool = False) -> JsonDict:
        """Start the Fig. 8 experiment and return at once.

        Args:
            deflection: coarse ticks from the spring's origin at which the shaft is to be at rest.
            duration_s: recorded time in s; None lets the daemon choose.
            force: as in :meth:`start`.

        Returns:
            ``{"experiment": id, "achieved_deflection": ticks, "duration_s": s, "run": path or None, "guard": …}``.

        Raises:
            Refused: not in a state that allows it, or another experiment is running.
        """

    def excite(self, name: str, options: dict[str, Any], force: bool = False) -> JsonDict:
        """Start an identification experiment and return at once.

        Args:
            name: a shape of ``hapticd.servo.excitation``, or ``all``.
            options: ``amplitude`` (A; rad or m for shapes that move the origin) and ``duration_s``, where given.
            force: as in :meth:`start`.

        Returns:
            ``{"experiment": id, "duration_s": s, "run": path or None, "guard": …}``.

        Raises:
            ExcitationError: unknown name, or beyond a limit of the config.
            Refused: not in a state that allows it, or another experiment is running.
        """

    def experiment(self) -> JsonDict:
        """The newest experiment.

        Returns:
            ``{"id", "kind", "state": idle | running | done | aborted, "progress": 0…1, "result": dict or None}``; the
            result of one that a fault ended carries the fault's code as ``fault``.
        """

    def record_start(self, path: str | None, trusted: bool = False) -> JsonDict:
        """Start recording to an absolute path, or to a new file in ``record.directory``. Returns the recorder's status.

        Args:
            path: the file; None names one.
            trusted: the caller is the daemon's own user, who may have it write anywhere, unless it is a service.

        Raises:
            Refused: already recording, the file exists, or (``outside``) it is outside ``record.directory``.
        """

    def record_stop(self) -> JsonDict:
        """Stop recording. Returns the recorder's status, ``path`` being the finished file.

        Raises:
            Refused: nothing is being recorded.
        """

    def reload(self, path: str | None, force: bool = False) -> JsonDict:
        """Read the config anew, from ``path`` (absolute path or preset name) or from where it came.

        Returns the status, and what the guard says as ``guard``; `force` as in :meth:`start`.

        Raises:
            ConfigError: the config is wrong; the one in force stays.
            Refused: keys that need a restart have changed; ``unstable``, as in :meth:`start`.
        """
