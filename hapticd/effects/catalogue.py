"""Every effect: the files of this folder, and what other packages bring by entry points of the group ``hapticd.effects``.

Such an entry point names an `Effect` and has the effect's slug as its name. One that cannot be used is no reason to refuse
work that has nothing to do with it: it is left out, and whoever asks for it by name is told why (`BROKEN`).
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pkgutil import iter_modules
from types import MappingProxyType

import hapticd.effects
from hapticd.effects.spec import ACTS_ON, Effect

GROUP = "hapticd.effects"

HOOK_ROOM = 64
"""Words that a device vector has for effects whose law is called through a pointer (`hapticd.plant.layout`)."""
HOOK_HEADER = 4
"""Words of such an effect besides its parameters."""

_NO_EFFECTS = frozenset({"catalogue", "pages", "parameters", "spec"})
_HOOKS = {"force": 4, "friction": 3}
"""Laws of an effect from outside, and how many arguments come before its parameters."""


def _own() -> dict[str, Effect]:
    names = [module.name for module in iter_modules(hapticd.effects.__path__) if module.name not in _NO_EFFECTS]
    effects = [import_module(f"hapticd.effects.{name}").EFFECT for name in names]
    effects.sort(key=lambda effect: (ACTS_ON.index(effect.acts_on), effect.slug))
    return {effect.slug: effect for effect in effects}


def _with_outside(own: Mapping[str, Effect]) -> tuple[dict[str, Effect], dict[str, str]]:
    """The effects of this folder and those of entry points, and why an entry point is left out."""
    effects, origins, broken = dict(own), {}, {}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        origin = (
            f"entry point {entry.name} = {entry.value} of {entry.dist.name if entry.dist else 'an unknown package'}"
        )
        try:
            effect = entry.load()
        except Exception as error:
            broken[entry.name] = f"{origin}: {type(error).__name__}: {error}"
            continue
        if problem := next(_problems(entry, effect, effects), None):
            broken[entry.name] = f"{origin}: {problem}"
        else:
            effects[effect.slug] = effect
            origins[effect.slug] = origin
    for slug, origin in origins.items():
        effect = effects[slug]
        others = {*effect.near, *effect.equivalent_to, *effect.contains, *effect.excludes}
        if unknown := sorted(others - effects.keys()):
            broken[slug] = f"{origin}: it names {', '.join(unknown)}, which the catalogue does not have"
            del effects[slug]
            continue
        for other in effect.equivalent_to:
            known = effects[other].equivalent_to
            effects[other] = replace(effects[other], equivalent_to=tuple(dict.fromkeys((*known, slug))))
    return effects, broken


def _problems(entry: EntryPoint, effect: object, known: Mapping[str, Effect]) -> Iterator[str]:
    if not isinstance(effect, Effect):
        yield f"is not a hapticd.effects.Effect but {type(effect).__name__}"
        return
    if effect.slug != entry.name:
        yield f"the effect's slug is {effect.slug}; entry point and slug have one name"
    if not re.fullmatch(r"[a-z][a-z0-9_]*", effect.slug):
        yield "a slug is lower-case letters, digits and underscores"
    if effect.slug in known:
        yield "the catalogue has an effect of that name already"
    if effect.acts_on not in ACTS_ON:
        yield f"acts_on is {effect.acts_on!r}; must be one of {', '.join(ACTS_ON)}"
    elif effect.is_hooked and effect.acts_on not in _HOOKS:
        yield f"acts_on is {effect.acts_on!r}; a law from outside is a {' or a '.join(_HOOKS)}"
    names = [parameter.name for parameter in effect.parameters]
    if not names or len(set(names)) < len(names) or "name" in names:
        yield "it needs parameters, each with a name of its own other than 'name'"
    if effect.amplitude not in ("", *names[:1]):
        yield f"its amplitude is {effect.amplitude!r}; the parameter in which a law is linear comes first"
    if not effect.is_hooked:
        yield "it has neither a force nor a friction, so that the plant would not know what to do with it"
    room = HOOK_ROOM - 1 - sum(HOOK_HEADER + other.size for other in known.values() if other.is_hooked)
    if HOOK_HEADER + effect.size > room:
        left = max(room - HOOK_HEADER, 0)
        yield f"there is room for {left} more parameters of effects from outside, and it has {effect.size}"
    for hook, leading in _HOOKS.items():
        law = getattr(effect, hook)
        if law is not None and not _takes(law, leading + effect.size):
            yield f"{hook} must take {leading} numbers and the {effect.size} of its parameters"


def _takes(law: Callable[..., object], count: int) -> bool:
    try:
        inspect.signature(law).bind(*range(count))
    except (TypeError, ValueError):
        return False
    return True


_OWN = _own()
_ALL, _BROKEN = _with_outside(_OWN)

CATALOGUE: Mapping[str, Effect] = MappingProxyType(_ALL)
"""Slug to what is known of the effect: those of hapticd in the order of the documentation, then the others by name."""

OWN_SLUGS: tuple[str, ...] = tuple(_OWN)
"""The effects that hapticd itself has."""

EFFECT_SLUGS: tuple[str, ...] = tuple(CATALOGUE)
"""All effects."""

BROKEN: Mapping[str, str] = MappingProxyType(_BROKEN)
"""Name of an entry point that cannot be used to the reason, which names it."""
