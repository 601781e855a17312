"""Why an exchange failed, in words, from its memory."""

from __future__ import annotations

import os
from typing import Any, Final

from numpy.typing import NDArray

from drivers.canopen import layout as w
from drivers.canopen._others import UNNAMED
from drivers.canopen.bus import describe_command
from drivers.canopen.emcy import error_code_text
from drivers.canopen.state_machine import FAULT_BIT, name_of, transition
from drivers.canopen.supervision import back_bytes

_NMT_STATES: Final = {4: "stopped", 5: "operational", 127: "pre-operational"}


def _deaf(block: NDArray[Any]) -> str:
    node, samples, floats = int(block[w.NODE]), int(block[w.DETAIL]), block.view("f8")
    stopped = "the node was stopped by NMT"
    if samples < 0:
        return f"node {node} sent no TPDO 2 (0x{w.TPDO2 + node:03x}) with {-samples} samples in a row; {stopped}"
    demand = block[w.DEMAND] * floats[w.AMPERE_PER_DEMAND]
    return (
        f"node {node} does not follow its commands (RPDO 1, 0x{w.RPDO1 + node:03x}): in {samples} samples in a row its "
        f"demand was not one of the latest, last {demand:.3g} A with {floats[w.COMMANDED]:.3g} A commanded; {stopped}"
    )


def _written(node: int, detail: int) -> str:
    index, sub = detail & 0xFFFF, detail >> 16
    name = "an object" if detail == UNNAMED else f"object 0x{index:04x}" + (f":{sub}" if sub else "")
    return (
        f"another client writes {name} of the drive (SDO to node {node}), so the settings of bring-up may no "
        "longer be valid; the node was stopped by NMT"
    )


def remarks(block: NDArray[Any]) -> list[str]:
    """Observations on the bus that stop nothing."""
    node, found = int(block[w.NODE]), []
    if block[w.SDO_SEEN]:
        found.append(
            f"another client reads objects of the drive: {block[w.SDO_SEEN]} SDO frames of node {node} were not for this "
            "driver"
        )
    if block[w.UNASKED]:
        found.append(f"{block[w.UNASKED]} TPDO 1 of node {node} came without a SYNC")
    return found


def explain(block: NDArray[Any]) -> str | None:
    """What stopped the exchange; None if nothing did."""
    node, detail = int(block[w.NODE]), int(block[w.DETAIL])
    lost = {
        w.LOST_CLOSED: "the other side of the CAN connection has closed it",
        w.LOST_SOCKET: f"CAN interface: {os.strerror(detail) if detail else 'the interface failed'}",
        w.LOST_BUS_OFF: "bus-off: the CAN controller has left the bus after too many errors (wiring, termination, bit rate)",
        w.LOST_REBOOTED: f"node {node} rebooted: it sent its boot-up message and has lost its settings",
        w.LOST_GUARD: f"node {node} left {detail} guarding requests in a row without a valid answer",
        w.LOST_DEAF: _deaf(block),
        w.LOST_WRITTEN: _written(node, detail),
        w.LOST_MODE: (
            f"node {node} is in mode of operation {detail}, no longer in {block[w.MODE_WANTED]}: another client has changed "
            "it; the node was stopped by NMT"
        ),
        w.LOST_STATE: f"node {node} is {_NMT_STATES.get(detail, f'in NMT state {detail}')}, no longer operational",
    }
    if block[w.REASON] != 0:
        emcy = int(block[w.EMCY])
        before = f"; EMCY 0x{emcy:04x} ({error_code_text(emcy)})" if emcy else ""
        return lost[int(block[w.REASON])] + before
    statusword = int(block[w.STATUSWORD])
    if block[w.FAULT_REPORTED] != 0:
        code = int(block[w.EMCY] or block[w.ERROR_CODE])
        said = "EMCY" if block[w.EMCY] else "error code 0x603f"
        named = f"{said} 0x{code:04x} ({error_code_text(code)})" if code else "no EMCY was received"
        state = name_of(statusword) if statusword & FAULT_BIT else f"still {name_of(statusword)}"
        return f"node {node}: {named}; statusword 0x{statusword:04x}, {state}"
    if block[w.EVENT_TOLD] == w.EVENT_MASTER:
        return f"another master is on the bus: it sent {describe_command(detail, node)}"
    if block[w.EVENT_TOLD] == w.EVENT_SURPLUS:
        return (
            f"TPDO 1 of node {node} came without a SYNC ({detail} times since the start): another node "
            "uses its identifier, or the drive sends it without SYNC, and it is not known which one has the position"
        )
    if block[w.EVENT_TOLD] == w.EVENT_SYNCS:
        return (
            f"SYNC came {detail} times more than half a period too early: two devices produce it, or one at another "
            "rate than servo.rate_hz; only one may have bit 30 of 0x1005 set"
        )
    mapped = {w.EVENT_LENGTH: (1, w.TPDO1_BYTES), w.EVENT_LENGTH_2: (2, back_bytes(block))}
    if (event := mapped.get(int(block[w.EVENT_TOLD]))) is not None:
        return (
            f"TPDO {event[0]} of node {node} came with {detail} bytes, {event[1]} are mapped: another node uses its "
            "identifier, or another client changed the mapping"
        )
    if block[w.EVENT_TOLD] == w.EVENT_TRANSITION:
        return transition(detail, 1e-9 * w.TRANSITION_NS)
    return None
