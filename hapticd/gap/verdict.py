"""The verdict, one of five, and its statement."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hapticd.gap import constants

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hapticd.gap.result import GapNumbers, Remainder, Verdict


def decide(
    effects: Sequence[str],
    indistinguishable: Sequence[Sequence[str]],
    doubts: Sequence[str],
    gap: GapNumbers,
    remainder: Remainder,
    torque: float,
    *,
    are_all: bool = True,
) -> tuple[Verdict, str]:
    """Verdict and statement.

    Args:
        effects: slugs of the added effects.
        indistinguishable: for each, its ties, without equivalent laws.
        doubts: sentences with reasons why the named effects may be wrong.
        gap: the missing force before and after.
        remainder: of the missing force.
        torque: RMS torque of friction and current in the final model. If more is missing, the model is of another device.
        are_all: whether the whole catalogue was considered.
    """
    if gap.held_out_after > torque:
        too_much = (
            f"More force is missing ({gap.held_out_after:.3g} {gap.unit}) than the device's friction and current make "
            f"({torque:.2g} {gap.unit}): the model is of another device, or the current does not cause the motion."
        )
        return "unexplained", " ".join([too_much, *doubts, remainder.words])
    names = " and ".join(effects)
    is_floor = gap.held_out_after < constants.NOISE_FACTOR * gap.noise_floor
    left = not is_floor and any(entry["share"] > constants.MATTERS for entry in remainder.structure)
    force = f"missing {gap.held_out_before:.3g} {gap.unit} before, {gap.held_out_after:.3g} {gap.unit} after"
    if not effects and (left or doubts):
        none = "no effect of the catalogue" if are_all else "none of the effects that were asked for"
        statement = (
            f"Something is missing that {none} explains ({gap.held_out_before:.3g} {gap.unit}): {remainder.words}"
        )
        return "unexplained", " ".join([statement, *doubts])
    if not effects and gap.held_out_after > constants.UNSTRUCTURED_SHARE * torque:
        statement = (
            f"The missing force ({gap.held_out_after:.3g} {gap.unit}) depends on no coordinate, but it is more than "
            f"{constants.UNSTRUCTURED_SHARE:g} of what the device's friction and current make ({torque:.2g} {gap.unit}). "
            f"{remainder.words}"
        )
        return "unexplained", " ".join([statement, *doubts])
    if not effects:
        statement = (
            f"No effect is missing: the missing force is {gap.held_out_before:.3g} {gap.unit}, the noise floor "
            f"{gap.noise_floor:.2g} {gap.unit}."
        )
        return "no_missing_effect", " ".join([statement, *doubts])
    ambiguous = [(effect, others) for effect, others in zip(effects, indistinguishable, strict=True) if others]
    if ambiguous:
        choices = "; ".join(f"{effect} or {' or '.join(others)}" for effect, others in ambiguous)
        further = [*doubts, remainder.words] if left or doubts else []
        sure = " and ".join(effect for effect, others in zip(effects, indistinguishable, strict=True) if not others)
        known, besides = (f"Missing: {sure}. ", " besides") if sure else ("", "")
        statement = f"{known}These data do not distinguish which it is{besides}: {choices} ({force})."
        return "ambiguous", " ".join([statement, *further])
    if left or doubts or gap.held_out_after**2 > (1.0 - constants.EXPLAINED) * gap.held_out_before**2:
        return "partly_explained", " ".join([f"Missing: {names} ({force}).", *doubts, remainder.words])
    return "effect_found", f"Missing: {names} ({force})."


def doubts_about(at_bounds: Mapping[str, Sequence[str]], unnamed: Mapping[str, str]) -> list[str]:
    """Reasons why the named effects may be wrong, one sentence each.

    Args:
        at_bounds: law to its parameters that the data do not distinguish from the end of their range.
        unnamed: dropped law to the coordinate of the unnamed function that is better.
    """
    limits = [
        f"These data do not distinguish {' and '.join(names)} of {law} from a limit: a law at its limit is another law."
        for law, names in at_bounds.items()
    ]
    return limits + [
        f"{law} is not named: it predicts worse than an unnamed function of the {coordinate}."
        for law, coordinate in unnamed.items()
    ]
