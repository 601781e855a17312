"""The loop's memory: the record that drivers see keeps its layout, and threads do not share cache lines to write."""

from __future__ import annotations

import inspect

import numpy as np

from drivers import interface
from hapticd.servo import atomics
from hapticd.servo.loop import run


def test_the_exchange_record_is_the_drivers_sixteen_words() -> None:
    record = interface.EXCHANGE
    assert record.itemsize == 8 * interface.EXCHANGE_WORDS
    numbers = {name[2:].lower(): number for name, number in vars(interface).items() if name.startswith("X_")}
    offsets = {name: record.fields[name][1] for name in record.names or () if name != "reserved"}  # type: ignore[index]
    assert offsets == {name: 8 * number for name, number in numbers.items()}
    comments = inspect.getsource(interface)
    for name in offsets:
        kind = {"i": "i64", "f": "f64"}[record[name].kind]
        assert f'X_{name.upper()} = {numbers[name]}\n"""{kind}' in comments


def test_writers_have_cache_lines_of_their_own() -> None:
    supervisor = {atomics.SEQUENCE, atomics.HEARTBEAT_NS, atomics.STOP}
    recorder = {atomics.RING_TAIL}
    numbers = {value for name, value in vars(atomics).items() if name.isupper() and name != "SIZE"}
    lines = [{number // 8 for number in group} for group in (supervisor, recorder, numbers - supervisor - recorder)]
    assert not lines[0] & lines[1]
    assert not lines[0] & lines[2]
    assert not lines[1] & lines[2]
    assert max(numbers) < atomics.SIZE
    assert len(numbers) == 23


def test_the_loop_takes_a_record_and_not_a_list_of_arrays() -> None:
    assert len(inspect.signature(run.py_func).parameters) <= 7


def test_blocks_a_driver_gets_are_whole_and_aligned() -> None:
    block = interface.new_exchange()
    assert block.view(interface.EXCHANGE).shape == (1,)
    assert block.ctypes.data % np.dtype(np.float64).alignment == 0
