"""Pieces of an HTML page: its style, and text with subscripts and code."""

from __future__ import annotations

import re
from html import escape
from typing import Final

STYLE: Final = """
:root { color-scheme: light dark; --paper: #fff; --ink: #1b1b1b; --soft: #5c5c5c; --line: #d9d9d9; --band: #f5f5f3;
  --good: #2e7d32; --bad: #a3341f; --link: #0b5fa5; }
@media (prefers-color-scheme: dark) { :root { --paper: #16181b; --ink: #e6e6e3; --soft: #a3a5a8; --line: #3a3d42;
  --band: #1f2226; --good: #7fc784; --bad: #f0937e; --link: #7db8ec; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2rem 1.2rem 4rem; max-width: 68rem; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, sans-serif; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0 0 .4rem; }
h2 { font-size: 1.3rem; margin: 3rem 0 .6rem; padding-top: 1rem; border-top: 1px solid var(--line); }
p, li { max-width: 46rem; }
a { color: var(--link); }
.soft, caption, figcaption { color: var(--soft); }
nav ol { columns: 2 22rem; padding-left: 1.4rem; }
figure { margin: 1rem 0; }
figure img { display: block; width: 100%; height: auto; background: #fff; border: 1px solid var(--line);
  border-radius: 6px; padding: .6rem; }
figcaption { font-size: .85rem; margin-top: .3rem; }
sub { line-height: 0; }
.scroll { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding-bottom: .3rem; }
th, td { padding: .28rem .7rem .28rem 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line); }
th { font-weight: 600; white-space: nowrap; }
td.n { text-align: right; white-space: nowrap; }
th.n { text-align: right; }
.trap { max-width: 48rem; background: var(--band); border-left: 3px solid var(--bad); padding: .5rem .9rem; margin: 1rem 0; }
.trap p { margin: .3rem 0; }
.good { color: var(--good); white-space: nowrap; }
.bad { color: var(--bad); font-weight: 600; white-space: nowrap; }
@media print { h2 { break-after: avoid; } figure, tr { break-inside: avoid; } }
"""

# one letter, with its dots, an underscore and what stands below: ξ̇_max, τ_D, H_T, e^(−jτ_Lω) being the one that ends early
_SUBSCRIPT: Final = re.compile("(?<![0-9A-Za-z_])([A-Za-zα-ωΑ-Ω][\u0307\u0308]?)_(max|[A-Z](?![a-z])|[a-z]+)")
_CODE: Final = re.compile("`([^`]+)`")


def text(content: str) -> str:
    """Plain text as HTML: escaped, ``x_y`` with y as a subscript, and words between backticks as code."""
    return _CODE.sub(r"<code>\1</code>", _SUBSCRIPT.sub(r"\1<sub>\2</sub>", escape(content)))
