"""Which effects these data cannot tell apart.

Two effects are tied when neither predicts held-out windows better than chance would: whatever a table of near-ties says,
the data at hand decide. Effects of one exact class (the same law in other parameters) are tied on any data, and naming one
of them names all.

Some laws contain a simpler one as a limit: no data could ever exclude them when the simpler one is true. They are rivals
only where they predict better.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hapticd.effects.catalogue import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from hapticd.gap.hypothesis import Term
    from hapticd.gap.search import Data, Judged

RESOLVED = 3.0
"""Standard errors by which a rival must be behind to be ruled out: one in a thousand."""
_SIMPLER = 1.645
"""Standard errors by which a law must be better than one that it contains to be taken for it: one in twenty."""
_CONTAINED = {
    "thermal_drift": {"coulomb_friction"},  # t_w → 0
    "stribeck": {"coulomb_friction"},  # omega_s → ∞
    "hand_impedance": {"inertia_error", "viscous_friction"},  # held all the time
}


def exact_class(slug: str) -> tuple[str, ...]:
    """Effects with the very same law, `slug` itself not among them."""
    return CATALOGUE[slug].equivalent_to


def contains(rich: Term, slug: str) -> bool:
    """Whether a law has another one as a limit: one with parameters to spare."""
    orders = rich.form.get("orders")
    if rich.slug == "torque_ripple" and isinstance(orders, list):
        return slug == "gravity" and 1.0 in orders
    return slug in _CONTAINED.get(rich.slug, ())


def first(good: Iterable[str], round_of: Mapping[str, Judged], data: Data) -> str:
    """Of effects that are worth adding, the one that predicts held-out windows best, or a simpler one that is as good.

    Simpler is a law that the best one contains, and any law beside one that chooses the fate of each tick.
    """
    order = sorted(good, key=lambda slug: float(round_of[slug].held_out.loss.sum()))
    best = round_of[order[0]]
    term = _term(best, order[0])
    for slug in order[1:]:
        bar = RESOLVED if term.lost else _SIMPLER if contains(term, slug) else 0.0
        if slug == "gravity" and order[0] == "torque_ripple" and _mostly_gravity(best):
            return slug
        if best.ahead_of(round_of[slug], data) < bar:
            return slug
    return order[0]


def _mostly_gravity(judged: Judged) -> bool:
    """Whether the largest amplitude of a ripple is that of once per revolution."""
    hypothesis = judged.hypothesis
    number = hypothesis.slugs.index("torque_ripple")
    term = hypothesis.terms[number]
    orders = term.form.get("orders")
    if not isinstance(orders, list) or 1.0 not in orders:
        return False
    found = term.parameters(hypothesis.share(judged.fit.solution.u, number))
    sizes = [found[f"amplitudes[{k}]"] for k in range(len(orders))]
    return bool(orders[sizes.index(max(sizes))] == 1.0)


def rivals(winner: str, round_of: Mapping[str, Judged], data: Data) -> list[str]:
    """Candidates of a round that are not ruled out against its winner, best first."""
    best = round_of[winner]
    tied = []
    for slug, judged in round_of.items():
        if slug == winner or contains(_term(judged, slug), winner):
            continue
        if best.ahead_of(judged, data) < RESOLVED:
            tied.append(slug)
    return sorted(tied, key=lambda slug: float(round_of[slug].held_out.loss.sum()))


def _term(judged: Judged, slug: str) -> Term:
    return next(term for term in judged.hypothesis.terms if term.slug == slug)


def across_classes(winner: str, tied: list[str]) -> list[str]:
    """Those of the tied effects that are another law than the winner."""
    return [slug for slug in tied if slug not in exact_class(winner)]
