"""Size and worst stack depth of every board that is built: python3 report.py [--json].

The stack of a function is gcc's (-fstack-usage), what it calls is read out of the disassembly. The worst depth is that of
the main program with one interrupt of every priority on top of it. Recursion and calls through pointers are errors.
"""

import argparse
import json
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

BUILD = Path(__file__).parent / "build"
CORTEX_M_FRAME = 32 + 4  # what the processor pushes at an interrupt, and its alignment (Arm DDI 0403, B1.5.6)
UNKNOWN_AVR = 8  # registers that a helper of libgcc may push, and its return address


@dataclass(frozen=True)
class Board:
    """How to read a board's binary; ``levels`` are its interrupts by priority, the main program first."""

    image: str
    tools: str
    levels: tuple[tuple[str, ...], ...]
    frame: int
    helpers: int = 0


BOARDS = {
    "mps2-an385": Board(
        "board.elf",
        "arm-none-eabi-",
        (("reset",), ("uart_rx_interrupt", "uart_tx_interrupt"), ("tick_interrupt",), ("watchdog_interrupt",)),
        CORTEX_M_FRAME,
    ),
    "nucleo-g474re": Board(
        "board.elf",
        "arm-none-eabi-",
        (("reset",), ("usart_interrupt",), ("tick_interrupt",), ("watchdog_interrupt",)),
        CORTEX_M_FRAME,
    ),
    # Interrupt vectors of the ATmega328P: 1 and 2 INT0 and INT1, 13 and 14 timers, 18 and 19 UART. Only the receiver's lets
    # others in, itself among them.
    "avr-uno": Board(
        "board.elf",
        "avr-",
        (
            ("main",),
            ("__vector_18",),
            ("__vector_1", "__vector_2", "__vector_13", "__vector_14", "__vector_18", "__vector_19"),
        ),
        0,  # gcc counts the return address in
        UNKNOWN_AVR,
    ),
}

_FUNCTION = re.compile(r"^[0-9a-f]+ <([^>]+)>:$")
_CALL = re.compile(r"\s(bl|b|b\.n|b\.w|call|rcall|jmp|rjmp)\s[^<]*<([^>+]+)>\s*$")
_INDIRECT = re.compile(r"\s(?:blx\s+r\d+|icall|eicall)\s*$")


def usage(folder: Path) -> dict[str, int]:
    """Bytes of stack by function."""
    found: dict[str, int] = {}
    for file in folder.glob("*.su"):
        for line in file.read_text().splitlines():
            place, size, kind = line.split("\t")
            if "dynamic" in kind:
                sys.exit(f"{place}: a stack of no known size")
            name = place.rsplit(":", 1)[1]
            found[name] = max(found.get(name, 0), int(size))
    return found


def calls(image: Path, tools: str) -> dict[str, set[str]]:
    """What each function calls or jumps to."""
    text = subprocess.run([f"{tools}objdump", "-d", image], capture_output=True, text=True, check=True).stdout
    found: dict[str, set[str]] = {}
    at = ""
    for line in text.splitlines():
        if match := _FUNCTION.match(line):
            at = match[1]
            found[at] = set()
        elif match := _CALL.search(line):
            if match[2] != at or match[1] in ("bl", "call", "rcall"):  # a jump to one's own beginning is a loop
                found[at].add(match[2])
        elif _INDIRECT.search(line):
            sys.exit(f"{image}: {at} calls through a pointer")
    return found


def deepest(
    function: str, sizes: dict[str, int], graph: dict[str, set[str]], helpers: int, above: tuple[str, ...]
) -> int:
    """Bytes from here down. Exits on recursion."""
    if function in above:
        sys.exit(f"recursion: {' → '.join((*above, function))}")
    own = sizes.get(function.split(".")[0], helpers)
    below = (deepest(called, sizes, graph, helpers, (*above, function)) for called in graph.get(function, ()))
    return own + max(below, default=0)


def examine(name: str, board: Board) -> dict[str, int | str]:
    """One row of the report."""
    folder = BUILD / name
    image = folder / board.image
    size = subprocess.run([f"{board.tools}size", image], capture_output=True, text=True, check=True).stdout
    text, data, bss = (int(word) for word in size.splitlines()[1].split()[:3])
    sizes, graph = usage(folder), calls(image, board.tools)
    for entry in (entry for level in board.levels for entry in level):
        if entry not in graph:
            sys.exit(f"{image} has no function {entry}")
    depths = [max(deepest(entry, sizes, graph, board.helpers, ()) for entry in level) for level in board.levels]
    worst = sum(depths) + board.frame * (len(depths) - 1)
    return {"board": name, "flash": text + data, "ram": data + bss, "stack": worst}


def main() -> None:
    """Print the report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON document")
    as_json = parser.parse_args().json
    rows = [examine(name, board) for name, board in BOARDS.items() if (BUILD / name / board.image).exists()]
    if as_json:
        print(json.dumps(rows))
        return
    print(f"{'board':15} {'flash, B':>9} {'static RAM, B':>14} {'worst stack, B':>15}")
    for row in rows:
        print(f"{row['board']:15} {row['flash']:9} {row['ram']:14} {row['stack']:15}")


if __name__ == "__main__":
    main()
