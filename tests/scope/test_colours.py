"""The curves of a lane for colour-blind people: told apart by colour as they see it or by dashes, seen on their ground."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page

LOOKS = """async () => {
    const { LOOK } = await import("/static/js/lane.js");
    const style = getComputedStyle(document.documentElement);
    const of = (name, dash) => ({ colour: style.getPropertyValue(name).trim(), dash });
    const seen = (channel) => of(LOOK[channel].colour, Boolean(LOOK[channel].dash));
    const lanes = [["position", "coarse", "model"], ["current", "measured"]].map((channels) => channels.map(seen));
    lanes.push([of("--c1", false), of("--c3", false), of("--ink", true)]);
    return { lanes, ground: style.getPropertyValue("--panel").trim() };
}"""
"""The curves of position and current, and of the X-Y lane: now, the releases before, the ideal spring."""

SEEN = {
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
}
"""On linear RGB; Machado, Oliveira, Fernandes (2009), severity 1."""
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
APART = 20.0
"""CIELAB distance; one is the least that is noticed side by side."""
CONTRAST = 3.0
"""WCAG 2.1, 1.4.11, of graphics."""


def linear(colour: str) -> NDArray[np.float64]:
    """Linear RGB of #rrggbb."""
    value = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lab(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """CIELAB, D65."""
    x, y, z = np.cbrt(np.clip(XYZ @ np.clip(rgb, 0, 1) / XYZ.sum(axis=1), 1e-6, None))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("kind", SEEN)
def test_curves_are_told_apart(page: Page, scheme: Any, kind: str) -> None:
    page.emulate_media(color_scheme=scheme)
    found = page.evaluate(LOOKS)
    seen = np.array(SEEN[kind])
    ground = XYZ[1] @ linear(found["ground"])
    for lane in found["lanes"]:
        for one, other in combinations(lane, 2):
            distance = np.linalg.norm(lab(seen @ linear(one["colour"])) - lab(seen @ linear(other["colour"])))
            assert one["dash"] != other["dash"] or distance > APART, (one, other, distance)
        for curve in lane:
            luminance = XYZ[1] @ np.clip(seen @ linear(curve["colour"]), 0, 1)
            darker, lighter = sorted((luminance, ground))
            assert (lighter + 0.05) / (darker + 0.05) > CONTRAST, (curve, found["ground"])
