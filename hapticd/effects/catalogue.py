"""Every effect: the files of this folder, and those of other packages by entry points of the group ``hapticd.effects``.

Such an entry point refers to an `Effect` and has the effect's slug as its name. One that cannot be used is left out,
because it must not affect other work; a request for it by name gets the reason (`BROKEN`).
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
"""Words of a device vector for effects whose law is called through a pointer (`hapticd.plant.layout`)."""
HOOK_HEADER = 4
"""Words of such an effect before its parameters."""

_NO_EFFECTS = frozenset({"catalogue", "pages", "parameters", "spec"})
_HOOKS = {"force": 4, "friction": 3}
"""Laws of an effect from another package, and number of arguments before its parameters."""


def _own() -> dict[str, Effect]:
    names = [module.name for module in iter_modules(hapticd.effects.__path__) if module.name not in _NO_EFFECTS]
    effects = [import_module(f"hapticd.effects.{name}").EFFECT for name in names]
    effects.sort(key=lambda effect: (ACTS_ON.index(effect.acts_on), effect.slug))
    return {effect.slug: effect for effect in effects}


def _with_outside(own: Mapping[str, Effect]) -> tuple[dict[str, Effect], dict[str, str]]:
    """The effects of this folder and of entry points, and the reason for each entry point that is left out."""
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
            broken[slug] = f"{origin}: it refers to {', '.join(unknown)}, which the catalogue does not have"
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
        yield f"the effect's slug is {effect.slug}; the entry point must have the same name"
    if not re.fullmatch(r"[a-z][a-z0-9_]*", effect.slug):
        yield "a slug must be lower-case letters, digits and underscores"
    if effect.slug in known:
        yield "the catalogue already has an effect of that name"
    if effect.acts_on not in ACTS_ON:
        yield f"acts_on is {effect.acts_on!r}; must be one of {', '.join(ACTS_ON)}"
    elif effect.is_hooked and effect.acts_on not in _HOOKS:
        yield f"acts_on is {effect.acts_on!r}; an effect of another package must have a {' or a '.join(_HOOKS)}"
    names = [parameter.name for parameter in effect.parameters]
    if not names or len(set(names)) < len(names) or "name" in names:
        yield "it needs parameters with different names, none of them 'name'"
    if effect.amplitude not in ("", *names[:1]):
        yield f"its amplitude is {effect.amplitude!r}; it must be the first parameter, in which the law is linear"
    if not effect.is_hooked:
        yield "it has neither a force nor a friction for the plant"
    room = HOOK_ROOM - 1 - sum(HOOK_HEADER + other.size for other in known.values() if other.is_hooked)
    if HOOK_HEADER + effect.size > room:
        left = max(room - HOOK_HEADER, 0)
        yield f"it has {effect.size} parameters; there is room for {left} more of effects of other packages"
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
"""Slug to effect: those of hapticd in the order of the documentation, then the others by name."""

OWN_SLUGS: tuple[str, ...] = tuple(_OWN)
"""The effects of hapticd itself."""

EFFECT_SLUGS: tuple[str, ...] = tuple(CATALOGUE)
"""All effects."""

BROKEN: Mapping[str, str] = MappingProxyType(_BROKEN)
"""Name of an entry point that cannot be used to the reason."""
