"""What the suite and the matrix found, as JSON-ready values and as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hapticd.hil import delay
from hapticd.hil.matrix import Row
from hapticd.hil.suite import CaseResult, SuiteResult


def suite_document(result: SuiteResult) -> dict[str, Any]:
    """The suite's answer as data."""
    return {
        "driver": result.driver,
        "agrees": result.agrees,
        "cases": [_case(case) for case in result.cases],
        "latency": {
            **delay.document(_delay(result), result.declared_s, delay.realtime_kernel()),
            "commands": len(result.latency_s),
        },
        "timing": result.timing,
        "warnings": list(result.warnings),
    }


def _case(case: CaseResult) -> dict[str, Any]:
    return {
        "name": case.name,
        "what": case.what,
        "agrees": not case.problems,
        "problems": list(case.problems),
        **case.report,
        "current_rms_error": case.comparison.current_rms_error,
        "position_rms_error_ticks": case.comparison.position_rms_error,
        "compared_periods": case.comparison.swing,
    }


def suite_text(result: SuiteResult) -> str:
    """The suite's answer for a person."""
    lines = [
        f"{'case':11} {'outcome':11} {'simulated':11} {'rest at':>9} {'simulated':>9}  {'current':>8}  verdict",
    ]
    for case in result.cases:
        report = case.report
        rests = report.get("outcome") == "decaying"
        error = case.comparison.current_rms_error
        lines.append(
            f"{case.name:11} {report.get('outcome') or '-':11} {report.get('simulated_outcome') or '-':11} "
            f"{_ticks(report.get('final_ticks') if rests else None)} "
            f"{_ticks(report.get('simulated_final_ticks') if rests else None)}  "
            f"{100 * error:6.2f} %  {'agrees' if not case.problems else '; '.join(case.problems)}"
        )
    lines += ["", "rest in coarse ticks; current: RMS difference over the first swing", "", *_latency_lines(result)]
    timing = result.timing
    lines.append(
        f"missed        {timing['missed']} periods, {timing['exchanges_missed']} exchanges of {timing['ticks']}"
    )
    lines += [f"warning: {warning}" for warning in result.warnings]
    lines.append("")
    lines.append(
        "The device does what the simulation says." if result.agrees else "The device and the simulation differ."
    )
    return "\n".join(lines)


def _delay(result: SuiteResult) -> delay.Delay | None:
    return delay.measured(result.latency_s, result.declared_s)


def _latency_lines(result: SuiteResult) -> list[str]:
    found = _delay(result)
    if found is None:
        return ["latency       no command followed its sample in the device's log: no verdict"]
    return [
        f"latency       sample to current {1e6 * found.median_s:.0f} µs median, {1e6 * found.p99_s:.0f} µs p99, "
        f"{1e6 * found.max_s:.0f} µs max, in the device's log",
        f"declared      {1e6 * found.declared_s:.0f} µs by the driver, which check and simulate use",
        f"verdict       {delay.verdict(found, delay.realtime_kernel())}",
    ]


def _ticks(value: float | None) -> str:
    return f"{value:9.3f}" if value is not None else f"{'-':>9}"


def matrix_document(rows: Sequence[Row]) -> dict[str, Any]:
    """The fault matrix as data."""
    return {
        "met": all(row.met for row in rows),
        "rows": [
            {
                "driver": row.driver,
                "fault": row.injection.name,
                "what": row.injection.what,
                "code": row.code,
                "cause": row.cause,
                "zero_current_after_s": row.zero_after_s,
                "exchanges_missed": row.tolerated,
                "periods_missed": row.missed_periods,
                "rows_lost": row.rows_lost,
                "periods_from_first_failed_exchange": row.after_first_miss,
                "problems": list(row.problems),
            }
            for row in rows
        ],
    }


_HEADER = ("device", "injected", "fault raised", "zero current after", "recording lost", "")


def _cells(row: Row) -> tuple[str, ...]:
    if row.injection.refused:
        raised, zero = "refused at start" if row.met else "started", "never on"
    else:
        counted = f"none; {row.tolerated} exchanges counted" if row.tolerated else "none"
        raised = f"`{row.code}`" if row.code else counted
        zero = "goes on" if row.zero_after_s is None else f"{1e3 * row.zero_after_s:.2f} ms"
    verdict = "as it must be" if row.met else "; ".join(row.problems)
    return row.driver, row.injection.what, raised, zero, f"{row.rows_lost} rows", verdict


def matrix_text(rows: Sequence[Row]) -> str:
    """The fault matrix as a table of plain text."""
    table = [_HEADER, *(_cells(row) for row in rows)]
    widths = [max(len(line[column]) for line in table) for column in range(len(_HEADER))]
    text = [
        "  ".join(cell.replace("`", "").ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in table
    ]
    broken = sum(not row.met for row in rows)
    return "\n".join([*text, "", f"{len(rows) - broken} of {len(rows)} as they must be"])


def matrix_markdown(rows: Sequence[Row]) -> str:
    """The fault matrix as rows of a Markdown table."""
    lines = ["| " + " | ".join(_HEADER) + " |", "|" + "---|" * len(_HEADER)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in _cells(row)) + " |" for row in rows]
    return "\n".join(lines) + "\n"
