"""How a report looks, on screen and on paper."""

__all__ = ["STYLE"]

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin: 0; }
h2 { font-size: 1.1rem; margin: 1.6rem 0 .4rem; border-bottom: 1px solid #ccd; }
.verdict { display: inline-block; font-weight: 600; padding: .2rem .8rem; border-radius: .3rem; color: #fff; }
.verdict.pass { background: #2b7a3d; }
.verdict.refused { background: #b3261e; }
dl { display: grid; grid-template-columns: 9rem 1fr; gap: .2rem 1rem; margin: .6rem 0 1rem; }
dt { font-weight: 600; }
dd { margin: 0; }
img { width: 100%; border: 1px solid #ccd; }
table { border-collapse: collapse; }
td { padding: .15rem 1rem .15rem 0; vertical-align: top; }
tr.passed td:last-child { color: #2b7a3d; }
tr.broken td { color: #b3261e; font-weight: 600; }
tr.not td { color: #777; }
footer { margin-top: 2rem; color: #777; }
@media print { body { margin: 0; max-width: none; } h2 { break-after: avoid; } }
"""
