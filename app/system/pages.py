"""Pages for a browser that need no other file for their text and their look."""

from __future__ import annotations

from typing import Any

STYLE = """
:root { color-scheme: light dark; --ink: #1c1c1c; --paper: #fff; --line: #d5d5d5; --soft: #666;
  --good: #15703a; --busy: #1d4fa0; --bad: #a33218; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e6e6; --paper: #16181b; --line: #3a3d42; --soft: #a0a4aa; --good: #57b97e;
    --busy: #7fa9ee; --bad: #e8846c; }
}
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; margin: 0.6rem 0 1.2rem; font-size: 0.86rem; display: block;
  overflow-x: auto; }
th, td { border-bottom: 1px solid var(--line); padding: 0.22rem 0.6rem; text-align: left;
  vertical-align: top; }
td { font-variant-numeric: tabular-nums; }
thead th { border-bottom: 2px solid var(--line); }
figure { margin: 1.4rem 0; }
figure img { max-width: 100%; background: #fff; border: 1px solid var(--line); }
.as-printed { width: calc(var(--mm) * 1.4mm); }
figcaption, .soft { color: var(--soft); font-size: 0.86rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; } h3 { font-size: 1rem; }
nav ul { columns: 2; list-style: none; padding: 0; font-size: 0.9rem; }
nav .level3 { padding-left: 1.2em; }
sub, sup { font-size: 0.75em; line-height: 0; }
summary { cursor: pointer; }
.numbers { max-width: none; }
.numbers th, .numbers td { text-align: right; white-space: nowrap; }
.numbers .text { text-align: left; white-space: normal; }
.numbers td img { width: 150px; display: block; }
.note { max-width: 28em; }
.done .state { color: var(--good); } .running .state { color: var(--busy); font-weight: 600; }
.failed .state, .cut .state, .stopped .state { color: var(--bad); }
@page { size: A4; margin: 14mm 12mm; }
@page wide { size: A4 landscape; }
@media print {
  :root { color-scheme: light; --ink: #000; --paper: #fff; --line: #bbb; --soft: #444; }
  body { max-width: none; margin: 0; padding: 0; font-size: 10pt; }
  table { display: table; overflow: visible; width: 100%; font-size: 7.5pt; }
  th, td { padding: 0.15rem 0.3rem; }
  th { overflow-wrap: break-word; }
  thead { display: table-header-group; }
  tr, figure { break-inside: avoid; }
  h1, h2, h3 { break-after: avoid; }
  figure img { max-height: 200mm; object-fit: contain; }
  .as-printed { width: calc(var(--mm) * 1mm); }
  .wide { page: wide; }
}
""".strip()
_LAYOUT = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
{% block head %}{% endblock %}
<style>
{{ style | safe }}
</style>
</head>
<body{% block of_body %}{% endblock %}>
{% block body %}{% endblock %}
</body>
</html>
"""


def page(template: str, **values: Any) -> str:
    """A page by a template of jinja2 that fills the blocks `head`, `of_body` and `body`; what
    stands for a value is escaped.
    """
    from jinja2 import DictLoader, Environment

    layouts = DictLoader({"layout": _LAYOUT, "page": '{% extends "layout" %}' + template})
    made = Environment(loader=layouts, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    return made.get_template("page").render(values, style=STYLE) + "\n"
