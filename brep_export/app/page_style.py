"""How a report looks, on screen and on paper."""

__all__ = ["STYLE"]

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; max-width: 76rem; margin: 1rem auto; padding: 0 1rem; }
header { display: flex; align-items: baseline; gap: 1rem; margin-bottom: .7rem; }
h1 { font-size: 1.4rem; margin: 0; }
h2 { font-size: 1.1rem; margin: 1.6rem 0 .4rem; border-bottom: 1px solid #ccd; }
.verdict { font-weight: 600; padding: .15rem .8rem; margin: 0; border-radius: .3rem; color: #fff; }
.verdict.pass { background: #2b7a3d; }
.verdict.none { background: #5a6472; }
.verdict.refused { background: #b3261e; }
.answers { display: grid; grid-template-columns: repeat(3, 1fr); gap: .8rem; margin: .7rem 0; }
.answers div { border: 1px solid #ccd; border-left: .35rem solid #8a93a0; border-radius: .3rem; padding: .4rem .8rem; }
.answers .yes { border-left-color: #2b7a3d; }
.answers .no { border-left-color: #b3261e; }
dt { font-weight: 600; }
dd { margin: 0; }
ul.reasons { border: 1px solid #b3261e; border-radius: .3rem; padding: .4rem .8rem .4rem 1.8rem; }
#view { display: flex; height: min(62vh, 44rem); min-height: 24rem; border: 1px solid #ccd; border-radius: .3rem; }
.stage { position: relative; flex: 1; min-width: 0; background: linear-gradient(#dfe7ee, #fff); overflow: hidden; }
.stage canvas { position: absolute; inset: 0; touch-action: none; }
.sides { position: absolute; top: .5rem; left: .5rem; display: flex; flex-wrap: wrap; gap: .25rem; }
.choosers { display: flex; gap: .25rem; margin: .2rem 0; }
.sides button, .choosers button { font: inherit; font-size: .8rem; padding: .1rem .5rem; border: 1px solid #aab;
  border-radius: .3rem; background: #ffffffcc; }
.hint { position: absolute; bottom: .2rem; left: .6rem; margin: 0; font-size: .8rem; color: #667; }
.panel { width: 17rem; padding: .4rem .7rem; overflow-y: auto; border-left: 1px solid #ccd; font-size: .88rem; }
.panel fieldset { border: 0; padding: 0; margin: 0 0 .6rem; }
.panel legend { font-weight: 600; padding: 0; }
.panel label { display: flex; align-items: center; gap: .4rem; overflow-wrap: anywhere; }
.panel p { margin: .2rem 0; }
.rows { max-height: 11rem; overflow-y: auto; }
.swatch { flex: none; display: inline-block; width: .8rem; height: .8rem; margin-right: .3rem; border-radius: .2rem; }
.bars { display: flex; align-items: flex-end; height: 4rem; }
.bars i { flex: 1; }
.ramp { height: .7rem; }
.ticks { display: flex; justify-content: space-between; font-size: .8rem; }
.pictures img { width: 100%; border: 1px solid #ccd; margin-bottom: .4rem; }
.gallery figure { display: inline-block; margin: .4rem; text-align: center; }
.gallery figure[data-part] { cursor: pointer; }
.gallery figure[data-part]:hover { background: #eef2f7; }
.gallery svg { width: 200px; height: 200px; }
.gallery path { fill: none; stroke: #000; stroke-width: 1.5; vector-effect: non-scaling-stroke; }
.gallery path.h { stroke-width: .8; stroke-dasharray: 4 3; opacity: .6; }
.gallery select { font: inherit; }
table { border-collapse: collapse; }
td { padding: .12rem 1.2rem .12rem 0; vertical-align: top; }
tr.passed td:last-child { color: #2b7a3d; }
tr.broken td { color: #b3261e; font-weight: 600; }
tr.not td { color: #777; }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(24rem, 1fr)); gap: 0 2.5rem; }
footer { margin-top: 2rem; color: #777; font-size: .88rem; }
@media (max-width: 50rem) { .answers { grid-template-columns: 1fr; } #view { flex-direction: column; height: 90vh; }
  .panel { width: auto; max-height: 40%; border: 0; } }
@media print { body { margin: 0; max-width: none; } h2 { break-after: avoid; } #view { display: none; }
  .pictures { break-inside: avoid; } }
"""
