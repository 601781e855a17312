"""`images/wiring-*.svg`: how the boards of the reference firmware are wired, drawn by schemdraw."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import schemdraw
from schemdraw import elements as elm

IMAGES = Path(__file__).parent / "images"
_SPACING = 1.6


@dataclass(frozen=True)
class Wiring:
    """Names on both sides of the wires."""

    file: str
    board: str
    dac: str
    pins: dict[str, str]
    """Of the board, by what they are for."""
    dac_pins: tuple[str, str, str]


WIRINGS = (
    Wiring(
        "wiring-avr-uno.svg",
        "Arduino Uno",
        "MCP4922\nVREF 5 V, LDAC to GND",
        {
            "data": "D11 MOSI",
            "clock": "D13 SCK",
            "select": "D10 CS",
            "enable": "D8 enable",
            "fault": "D7 fault",
            "stop": "D6 stop",
            "held": "D4 held",
            "a": "D2 A",
            "b": "D3 B",
        },
        ("SDI", "SCK", "CS"),
    ),
    Wiring(
        "wiring-nucleo-g474re.svg",
        "NUCLEO-G474RE",
        "AD5662\npower-up at mid-scale",
        {
            "data": "D11 PA7",
            "clock": "D13 PA5",
            "select": "D9 PC7",
            "enable": "D6 PB10",
            "fault": "D8 PA9",
            "stop": "D7 PA8",
            "held": "D2 PA10",
            "a": "A0 PA0",
            "b": "A1 PA1",
        },
        ("DIN", "SCLK", "SYNC"),
    ),
)


def draw(wiring: Wiring) -> None:
    """Draw one board into its file."""
    order = ("data", "clock", "select", "fault", "enable", "stop", "held", "a", "b")
    with schemdraw.Drawing(file=str(IMAGES / wiring.file), show=False) as drawing:
        drawing.config(fontsize=11, unit=1.6)
        board = elm.Ic(
            pins=[elm.IcPin(wiring.pins[name], side="right", anchorname=name) for name in reversed(order)],
            pinspacing=_SPACING,
            edgepadW=2.0,
        ).label(wiring.board, "top")
        drawing += board
        dac = elm.Ic(
            pins=[
                *(elm.IcPin(name, side="left", anchorname=name) for name in reversed(wiring.dac_pins)),
                elm.IcPin("VOUT", side="right", anchorname="out"),
            ],
            pinspacing=_SPACING,
            edgepadW=1.6,
        ).label(wiring.dac, "top", fontsize=10)
        drawing += dac.at((board.data[0] + 2.5, board.select[1])).anchor(wiring.dac_pins[2])
        for name, pin in zip(order[:3], wiring.dac_pins, strict=True):
            drawing += elm.Line().at(getattr(board, name)).to(getattr(dac, pin))
        amplifier = elm.Ic(
            pins=[
                elm.IcPin("± 10 V command", side="left", anchorname="command", slot="3/3"),
                elm.IcPin("enable", side="left", anchorname="enable", slot="1/3"),
                elm.IcPin("fault (low)", side="left", anchorname="fault", slot="2/3"),
                elm.IcPin("motor", side="right", anchorname="motor"),
            ],
            pinspacing=_SPACING,
            edgepadW=2.8,
        ).label("servo amplifier in current mode", "top", fontsize=10)
        drawing += amplifier.at((dac.out[0] + 4.4, board.fault[1])).anchor("fault")
        drawing += elm.Line().at(board.enable).to(amplifier.enable)
        drawing += elm.Line().at(board.fault).to(amplifier.fault)
        corner = (amplifier.command[0] - 0.8, dac.out[1])
        drawing += elm.Line().at(dac.out).to(corner).label("level shifter: 0 … VREF to ± 10 V", "top", fontsize=9)
        drawing += elm.Line().at(corner).to((corner[0], amplifier.command[1]))
        drawing += elm.Line().at((corner[0], amplifier.command[1])).to(amplifier.command)
        motor = elm.Motor().at(amplifier.motor).right().label("motor", "right")
        drawing += motor
        pull = (board.enable[0] + 0.5, board.enable[1])
        drawing += elm.Dot().at(pull)
        drawing += elm.Line().at(pull).to((pull[0], pull[1] - 0.5))
        resistor = elm.Resistor().at((pull[0], pull[1] - 0.5)).right().label("10 k", "bottom", fontsize=9)
        drawing += resistor
        drawing += elm.Ground().at(resistor.end)
        button = elm.Button(nc=True).right().label("stop: opens", "top", fontsize=9)
        drawing += elm.Line().at(board.stop).to((board.stop[0] + 3.0, board.stop[1]))
        drawing += button.at((board.stop[0] + 3.0, board.stop[1]))
        drawing += elm.Ground().at(button.end)
        switch = elm.Button().right().label("enable: closed while held", "top", fontsize=9)
        drawing += elm.Line().at(board.held).to((board.held[0] + 3.0, board.held[1]))
        drawing += switch.at((board.held[0] + 3.0, board.held[1]))
        drawing += elm.Ground().at(switch.end)
        encoder = elm.Ic(
            pins=[
                elm.IcPin("B", side="left", anchorname="b", slot="1/2"),
                elm.IcPin("A", side="left", anchorname="a", slot="2/2"),
            ],
            pinspacing=_SPACING,
            edgepadW=1.6,
        ).label("encoder, 5 V", "bottom", fontsize=10)
        drawing += encoder.at((amplifier.fault[0], board.b[1])).anchor("b")
        drawing += elm.Line().at(board.a).to(encoder.a)
        drawing += elm.Line().at(board.b).to(encoder.b)
        drawing += (
            elm.Label().at((board.b[0] + 3.0, board.b[1] - 0.9)).label("grounds of all parts are joined", fontsize=9)
        )


if __name__ == "__main__":
    for each in WIRINGS:
        draw(each)
