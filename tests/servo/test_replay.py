"""Simulations that tick when a recorded loop did: missed periods are skipped, ticks are as late."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hapticd.cli.main import main
from hapticd.config import Config, apply_settings, load_config
from hapticd.hil.compare import recorded_times
from hapticd.record import RunFileError, RunWriter, read_run, run_metadata
from hapticd.record.schema import FLAG_HELD, FLAG_MISSED_PERIOD
from hapticd.servo.simulate import simulate

DEFLECTION = 682.0


def config(**settings: Any) -> Config:
    named = {key.replace("__", "."): value for key, value in settings.items()}
    return apply_settings(load_config(None), {"plant.coulomb": 5e-4, **named})


def rows_of(config: Config, times: NDArray[np.int64] | None, count: int = 600) -> NDArray[Any]:
    blocks: list[NDArray[Any]] = []
    simulate(
        config,
        count * config.period,
        deflection=DEFLECTION,
        replay=times,
        on_rows=lambda rows: blocks.append(rows.copy()),
    )
    return np.concatenate(blocks)


def grid(count: int, late_ns: int = 0) -> NDArray[np.int64]:
    return np.stack([np.arange(count), np.full(count, late_ns)]).astype(np.int64)


@pytest.mark.parametrize("settings", [{}, {"delay__computation_s": 1.7e-3}, {"encoder__decimation": 217}])
def test_a_loop_that_missed_nothing_is_the_plain_simulation(settings: dict[str, Any]) -> None:
    plain, replayed = rows_of(config(**settings), None), rows_of(config(**settings), grid(600))
    for name in plain.dtype.names or ():
        np.testing.assert_array_equal(plain[name], replayed[name], err_msg=name)


def test_missed_periods_are_skipped_and_change_the_motion() -> None:
    times = grid(600)
    times = np.delete(times, [*range(40, 44), 100, *range(130, 137)], axis=1)
    plain, replayed = rows_of(config(), None), rows_of(config(), times)
    np.testing.assert_array_equal(replayed["tick"], times[0])
    np.testing.assert_allclose(replayed["time_s"], times[0] * 1e-3, atol=1e-12)
    missed = replayed["tick"][(replayed["flags"] & FLAG_MISSED_PERIOD) != 0]
    assert missed.tolist() == [44, 101, 137]
    apart = np.abs(replayed["encoder_counts"] - plain["encoder_counts"][times[0]])
    assert apart[:40].max() == 0
    assert apart[40:].max() > 5  # a command held for five periods instead of one


def test_a_policy_that_holds_late_ticks_does_so_in_a_replay() -> None:
    times = np.delete(grid(200), [50, 51], axis=1)
    rows = rows_of(config(servo__overrun__policy="hold"), times)
    held = rows["tick"][(rows["flags"] & FLAG_HELD) != 0]
    assert 52 in held.tolist()


def test_lateness_moves_what_is_read() -> None:
    """Every other tick is late: all of them alike would be the same motion, later."""
    times = grid(300)
    times[1, 1::2] = 300_000
    late, plain = rows_of(config(), times), rows_of(config(), None, 300)
    assert late["wake_late_ns"].tolist() == times[1].tolist()
    behind = (late["encoder_counts"] - plain["encoder_counts"])[20:60]
    assert behind[1::2].mean() < -1.0  # the shaft had a third of a period more to come back
    assert abs(behind[::2].mean()) < abs(behind[1::2].mean()) / 2


def test_the_command_replays_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded, replayed = tmp_path / "recorded.arrow", tmp_path / "replayed.arrow"
    times = np.delete(grid(400, late_ns=30_000), [60, 61, 62], axis=1)
    wanted = rows_of(config(), times)
    with RunWriter(recorded, run_metadata(config().model_dump(mode="json"))) as writer:
        writer.write(wanted)
    words = ["--deflection", str(DEFLECTION), "--set", "plant.coulomb=5e-4"]
    assert main(["simulate", "--replay", str(recorded), *words, "-o", str(replayed)]) == 0
    found = read_run(replayed)
    for name in ("tick", "encoder_counts", "current_command_A", "wake_late_ns", "flags"):
        np.testing.assert_array_equal(found.columns[name], wanted[name], err_msg=name)
    assert main(["simulate", "--replay", str(recorded), "--duration", "1"]) == 2
    assert main(["simulate"]) == 2
    assert "one of --duration and --replay" in capsys.readouterr().err


def test_what_lacks_rows_is_not_replayed(tmp_path: Path) -> None:
    path = tmp_path / "lost.arrow"
    rows = rows_of(config(), None, 100)
    with RunWriter(path, run_metadata(config().model_dump(mode="json"))) as writer:
        writer.write(np.delete(rows, [50]))  # no flag: the loop has ticked
    with pytest.raises(RunFileError, match="rows are missing"):
        recorded_times(read_run(path))
