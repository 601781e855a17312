"""Table II: six devices and a human operator, recomputed and compared with the printed numbers."""

from __future__ import annotations

from hapticd.config.text import significant
from hapticd.reproduce.items import Comparison, Item, Progress, Table
from hapticd.stability import devices
from hapticd.stability.criterion import velocity_limit
from hapticd.stability.devices import HUMAN_OPERATOR, TABLE_II, Device, grip_fraction
from hapticd.stability.regions import region

_SYMBOL = {"mu": "μ", "beta": "β", "sigma": "σ"}


def build(quick: bool, progress: Progress) -> Item:
    """Build the item."""
    rows = [row for device in TABLE_II for row in devices.compare(device)]
    return Item(
        name="table2",
        title="Table II: parameters of common devices, recomputed",
        see=(
            "Every device has β far below ½ and σ above ½: they are not passive, and work because Coulomb friction "
            "dissipates enough below a speed limit (15). None of them is in region A.",
            "The human operator's damping, 4.8 N s/m, is far above any device's own. The last column says what share of it, "
            "in parallel with the device, brings β to ½, out of region E into A.",
        ),
        traps=(
            "T is rounded in print: the printed μ of Delta and Omega follows only with T = 1/3 ms, not 0.33 ms.",
            "Freedom 6: the printed β = 0.025 does not follow from its own row: b/(KT) = 0.01/(2400·10⁻³) = 0.0042. No "
            "rounding explains a factor of six. Both numbers are shown; neither is taken for right.",
            "The other differences are rounding: the interval is what columns that round to the printed ones can give.",
        ),
        tables=(_columns(), _derived()),
        comparisons=[_comparison(row) for row in rows],
        numbers={
            "rows": [
                {
                    "device": row.device,
                    "quantity": row.quantity,
                    "printed": row.printed,
                    "recomputed": row.recomputed,
                    "with_printed_period": row.recomputed_as_printed,
                    "relative_difference": row.difference,
                    "rounding_allows": [row.low, row.high],
                    "explained_by_rounding": row.explained,
                }
                for row in rows
            ],
            "unexplained": [f"{row.device} {row.quantity}" for row in rows if not row.explained],
        },
    )


def _comparison(row: devices.Comparison) -> Comparison:
    interval = f"rounding of the columns allows {row.low:.4g} to {row.high:.4g}"
    return Comparison(
        what=f"{row.device}: {_SYMBOL[row.quantity]}",
        source="paper, Table II",
        printed=row.printed,
        ours=row.recomputed,
        agrees=row.explained,
        note=f"{row.note}; {interval}" if row.note else interval,
    )


def _columns() -> Table:
    rows = [
        (d.name, d.inertia, d.viscous, d.coulomb, d.resolution, d.period, d.stiffness, d.mu, d.beta, d.sigma)
        for d in TABLE_II
    ]
    hand = HUMAN_OPERATOR
    rows.append(
        ("Human operator", f"{hand.inertia:.3f}", f"{hand.damping:g}", "", "", "", f"{hand.stiffness:g}", "", "", "")
    )
    header = ("device", "m (kg)", "b (N s/m)", "c (N)", "Δ (µm)", "T (ms)", "K (N/m)", "μ", "β", "σ")
    return Table(header, rows, "The table as printed.")


def _derived() -> Table:
    header = (
        "device",
        "region",
        "limit of E, ticks/period (15)",
        "limit, m/s",
        "β held by the operator",
        "share of grip into A",
    )
    return Table(header, [_derived_row(device) for device in TABLE_II], "What follows from the recomputed numbers.")


def _derived_row(device: Device) -> tuple[str | float, ...]:
    loop = device.loop
    limit = velocity_limit(loop.numbers)
    # the hand's own stiffness and inertia change neither β nor σ
    held = loop.with_hand(HUMAN_OPERATOR.inertia, HUMAN_OPERATOR.damping, HUMAN_OPERATOR.stiffness)
    slow = region(loop.numbers, 0.99 * limit)
    fraction = f"{significant(100.0 * grip_fraction(loop))} %"
    return device.name, slow, limit, loop.scales.xi_dot_to_velocity(limit), held.numbers.beta, fraction
