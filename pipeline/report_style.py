"""How the report's page looks: its colours on light and dark, its style sheet. Nothing is read or written."""

from __future__ import annotations

PALETTE = {
    "ink": ("#1b1f24", "#e3e7eb"),
    "muted": ("#59636e", "#9aa5b1"),
    "faint": ("#9fa9b4", "#66717d"),
    "rule": ("#d5dade", "#39414a"),
    "surface": ("#fdfdfe", "#14181d"),
    "shade": ("#eef1f4", "#20262d"),
    "link": ("#0b5cad", "#7fb8f0"),
    # Okabe and Ito's colours, told apart with any colour vision; lighter on dark.
    "series-1": ("#c94f00", "#ff9248"),
    "series-2": ("#0067a9", "#5db6f5"),
    "series-3": ("#00805e", "#35c99b"),
    "series-4": ("#a94d84", "#e39ac4"),
    "series-5": ("#8f7200", "#e0c341"),
}
"""Name -> colour on a light and on a dark page; each is the variable ``--name`` of the style sheet."""


def style_sheet() -> str:
    """The page's style sheet: the colours as variables, light, and dark where a screen asks for it; then the rules."""
    light, dark = (" ".join(f"--{name}: {pair[mode]};" for name, pair in PALETTE.items()) for mode in (0, 1))
    return f":root {{ {light} }}\n@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n{_RULES}"


_RULES = """\
html { color-scheme: light dark; background: var(--surface); color: var(--ink);
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", "Noto Sans", "Liberation Sans", Arial, sans-serif; }
body { max-width: 72rem; margin: 0 auto; padding: 0 1.25rem 4rem; overflow-wrap: break-word; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 2rem 0 .5rem; }
h2 { font-size: 1.3rem; line-height: 1.3; margin: 3rem 0 .75rem; padding-top: .5rem;
  border-top: 1px solid var(--rule); }
sub, sup { line-height: 0; }
p, figcaption, summary { max-width: 48rem; }
caption { max-width: min(48rem, 100vw - 2.5rem); }
header > p:first-of-type { color: var(--muted); }
header > p:nth-of-type(2) { font-size: 1.15rem; }
a { color: var(--link); }
code, pre { font-family: ui-monospace, "SF Mono", Menlo, Consolas, "Liberation Mono", monospace; font-size: .875em; }
pre { background: var(--shade); padding: .75rem 1rem; border-radius: 6px; overflow-x: auto; }
nav ul { display: flex; flex-wrap: wrap; gap: .25rem 1.25rem; margin: 1.5rem 0 0; padding: 0; list-style: none; }
section { scroll-margin-top: 1rem; }
figure { margin: 1.25rem 0 2rem; }
figcaption, caption, summary { font-size: .925rem; color: var(--muted); text-align: left; }
figcaption { margin-top: .5rem; }
.panels { display: grid; gap: 1rem; }
.columns-2 { grid-template-columns: repeat(2, minmax(0, 1fr)); }
.columns-3 { grid-template-columns: repeat(3, minmax(0, 1fr)); }
.columns-6 { grid-template-columns: repeat(6, minmax(0, 1fr)); gap: .25rem; }
.panel { min-width: 0; }
figure img { display: block; max-width: 100%; height: auto; }
.panel svg { display: block; width: 100%; height: auto; font-family: inherit; }
.panel svg * { stroke-linejoin: round; }
.legend { display: flex; flex-wrap: wrap; gap: .1rem 1.25rem; margin: 0 0 .5rem; padding: 0; list-style: none;
  font-size: .9rem; }
.legend svg { width: 26px; height: 12px; margin-right: .45rem; vertical-align: -1px; }
.scroll { overflow-x: auto; margin: 1rem 0 1.75rem; }
table { border-collapse: collapse; font-size: .9rem; }
.dense { font-size: .8rem; }
.dense th, .dense td { padding: .2rem .4rem; }
caption { padding-bottom: .4rem; }
th, td { padding: .25rem .7rem; text-align: left; vertical-align: top; border-bottom: 1px solid var(--rule); }
th:first-child, td:first-child { padding-left: 0; }
thead th { border-bottom: 1.5px solid var(--faint); vertical-align: bottom; font-weight: 600; }
th[scope=colgroup] { border-bottom: 1px solid var(--rule); text-align: center; }
tbody th { font-weight: 500; }
.n { text-align: right; font-variant-numeric: tabular-nums; }
.k { white-space: nowrap; }
.i { color: var(--muted); font-size: .9em; }
.wide .i { display: block; }
summary { cursor: pointer; margin: .5rem 0; }
.hidden { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); white-space: nowrap; }
@media screen and (max-width: 48rem) {
  .columns-2, .columns-3 { grid-template-columns: minmax(0, 1fr); }
  .columns-6 { grid-template-columns: repeat(3, minmax(0, 1fr)); }
}
@media print {
  @page { margin: 14mm; }
  html { font-size: 10pt; color-scheme: light; background: none; }
  body { max-width: none; padding: 0; }
  nav { display: none; }
  h2 { break-after: avoid; margin-top: 1.5rem; }
  .panel, .legend, tr { break-inside: avoid; }
  .legend { break-after: avoid; }
  figcaption { break-before: avoid; }
  .scroll { overflow: visible; }
  table { font-size: 8pt; }
  th, td { padding: .15rem .4rem; }
  details::details-content { content-visibility: visible; block-size: auto; }
}
"""
