"""What the page saves, the page opens, and gap, energy, plot and pandas: one column scheme, and no empty column."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Page, Route, expect

from hapticd.cli.main import main
from hapticd.config import parse_config
from hapticd.gap.data import load_recording
from hapticd.record import read_run
from tests.polling import wait_until

from .browser import Testbed
from .conftest import SIMULATED_MS
from .test_page import seen_rows, text
from .test_views import open_file, save


def release(page: Page, deflection: str, duration: str) -> None:
    page.click("#to-release")
    page.fill("#release-deflection", deflection)
    page.fill("#release-duration", duration)
    page.click("#release-form button")
    expect(page.locator("#release-outcome")).not_to_have_text("")


@pytest.mark.parametrize("kind", ["csv", "arrow"])
def test_a_release_round_trip(
    page: Page, testbed: Testbed, tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    testbed.client.set({"encoder.decimation": 217, "servo.rate_hz": 500})
    expect(page.locator("#set-servo-rate_hz-confirmed")).to_have_text("500")
    release(page, "10.3", "1")
    expect(page.locator("#release-residual")).to_contain_text("ticks RMS", timeout=SIMULATED_MS)
    path = save(page, kind, tmp_path / f"seen.{kind}")
    run = read_run(path)
    assert run.metadata["config"]["encoder"]["decimation"] == 217
    if kind == "csv":
        table = pd.read_csv(path)
        # the simulation lies over the rendered rows alone: NaN before and after it, numbers in it
        assert not table.drop(columns=["model_ticks", "residual_ticks"]).isna().any(axis=None)
        assert table.model_ticks.notna().sum() >= 450
        assert json.loads(table.hapticd[0])["config"]["spring"]["stiffness"] == 0.012
    open_file(page, path)
    expect(page.locator("#file-name")).to_have_text(f"seen.{kind}: {run.rows} rows")
    again = read_run(save(page, kind, tmp_path / f"again.{kind}"))
    for name in ("tick", "encoder_counts", "current_command_A", "flags"):
        np.testing.assert_array_equal(again.columns[name], run.columns[name], err_msg=name)
    assert again.metadata["config"] == run.metadata["config"]
    capsys.readouterr()
    assert main(["energy", str(path), "--json"]) in (0, 1)
    assert sum(json.loads(capsys.readouterr().out)["dissipated_J"].values()) > 0.0
    assert main(["plot", str(path), "-o", str(tmp_path / f"{kind}.png")]) == 0
    model = parse_config(run.metadata["config"], "the run's own")
    assert load_recording(path, model).position.size == run.rows


def test_csv_waits_for_the_simulation(page: Page, testbed: Testbed, tmp_path: Path) -> None:
    waiting: list[Route] = []
    page.route("**/api/simulate", lambda route: waiting.append(route))
    release(page, "3", "0.3")
    page.click("#to-files")
    with page.expect_download() as found:
        page.click("#save-csv")
        expect(page.locator("#file-answer")).to_contain_text("waiting for the simulation")
        waiting[0].continue_()
    path = tmp_path / "seen.csv"
    found.value.save_as(path)
    assert pd.read_csv(path).model_ticks.notna().sum() > 200
    assert text(page, "#file-answer") == ""


def test_csv_without_a_simulation_has_no_such_columns(page: Page, testbed: Testbed, tmp_path: Path) -> None:
    wait_until(lambda: seen_rows(page) > 300, "rows")
    page.click("#run")
    table = pd.read_csv(save(page, "csv", tmp_path / "seen.csv"))
    assert "model_ticks" not in table
    assert not table.isna().any(axis=None)


def test_a_file_of_another_device_is_saved_with_its_own_config(page: Page, run_file: Path, tmp_path: Path) -> None:
    open_file(page, run_file)
    saved = read_run(save(page, "arrow", tmp_path / "saved.arrow"))
    assert saved.metadata["config"] == read_run(run_file).metadata["config"]
    assert saved.metadata["config"]["encoder"]["decimation"] == 217  # the live device has 1
