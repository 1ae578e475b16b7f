"""The criticism of one subject as one self-contained HTML page."""

import base64
from pathlib import Path

import jinja2

from regional_lv.criticism import words
from regional_lv.criticism.contract import read_findings
from regional_lv.plots import criticism as figures

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Criticism of {{ f.subject }}</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62em; margin: 2em auto; padding: 0 1em;
       color: #1a1a1a; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 2em; }
.verdict { border-left: 4px solid {{ colour }}; padding: .2em 1em; background: #f6f6f6; }
table { border-collapse: collapse; font-size: .87em; width: 100%; }
th, td { text-align: left; padding: .25em .6em; border-bottom: 1px solid #ddd; vertical-align:
top; }
td.n { text-align: right; white-space: nowrap; } img { max-width: 100%; }
.small { font-size: .87em; color: #444; }
</style></head><body>
<h1>What the simulation gets wrong about {{ f.subject }}</h1>
{% if f.subjects|length > 1 %}<p class="small">{{ f.subjects|length }} hearts together, one value of
every cause for all of them.</p>{% endif %}
<div class="verdict">{% for s in f.words %}<p>{{ s }}</p>{% endfor %}</div>

<h2>Where: residuals of each segment, predicted from all others</h2>
<img alt="Residual bullseyes" src="{{ images.residuals }}">
<p class="small">Observed minus predicted, in standard deviations of the prediction (emulator error,
noise, and the uncertainty of the stiffness given the other channels). Seen from the apex, anterior
at the top, septum on the left.</p>
<table><tr><th>test</th><th>p-value</th>
{% if f.remaining %}<th>with the best set</th>{% endif %}</tr>
{% for family, p in f.misfit.families.items() %}<tr><td>{{ families.get(family, family) }}</td>
<td class="n">{{ "%.3f"|format(p) }}</td>
{% if f.remaining %}<td class="n">{% if family in f.remaining.families %}{{
"%.3f"|format(f.remaining.families[family]) }}{% endif %}</td>{% endif %}</tr>{% endfor %}
<tr><td><b>all together</b></td><td class="n"><b>{{ "%.3f"|format(f.misfit.p_value) }}</b></td>
{% if f.remaining %}<td class="n"><b>{{ "%.3f"|format(f.remaining.p_value) }}</b></td>{% endif %}
</tr></table>
{% if f.data_checks %}<p>Checks of the strains alone, without the simulator:</p><ul>
{% for c in f.data_checks %}<li>{% if f.subjects|length > 1 %}{{ c.subject }}: {% endif %}{{ c.says
}} ({{ "passed" if c.passed else "failed" }}).</li>{% endfor %}</ul>{% endif %}

<h2>Why: the sets of causes</h2>
{% if f.sets %}<table><tr><th>set</th><th>probability</th><th>log evidence</th><th>gain</th>
<th>misfit p</th><th>simulated</th></tr>
{% for s in f.sets %}<tr><td>{% for c in s.causes %}{{ cause(c, s.components[loop.index0]) }}
{% if not loop.last %} + {% endif %}{% endfor %}</td>
<td class="n">{{ "%.3f"|format(s.probability) }}</td>
<td class="n">{{ "%+.1f"|format(s.log_evidence) }}</td>
<td class="n">{% if s.elpd_gain is not none %}{{ "%.1f"|format(s.elpd_gain) }} &plusmn;
{{ "%.1f"|format(s.elpd_gain_se) }}{% else %}-{% endif %}</td>
<td class="n">{{ "%.3f"|format(s.misfit_p_value) if s.misfit_p_value is not none else "-" }}</td>
<td class="n">{% if s.simulations %}{{ s.simulations }}, {{ number(s.difference_sd, 2) }} sd{{
"" if s.confirmed else ", elsewhere" }}{% else %}-{% endif %}</td></tr>{% endfor %}
<tr><td><i>the model as it is</i></td><td class="n">{{ "%.3f"|format(f.base_probability) }}</td>
<td class="n">0</td><td></td><td></td><td></td></tr>
<tr><td><i>a smooth discrepancy that no listed cause explains</i></td>
<td class="n">{{ "%.3f"|format(f.unlisted_probability) }}</td>
<td></td><td></td><td></td><td></td></tr>
</table>
<p class="small">Log evidence: against the model as it is. Gain: log predictive density of every
segment (and the volume) given all others; its standard error is over repeated measurements of the
same heart. Simulated: simulations with all effects of the set at once, and the largest difference
between simulated and emulated channels, which was corrected; elsewhere: an estimate is more than
{{ "%.0f"|format(farthest) }} standard deviations from those that were simulated, so that the
correction is extrapolated and the set not confirmed.</p>{% endif %}
<h2>Causes one by one</h2>
<img alt="Scores and probabilities of causes" src="{{ images.causes }}">
<table><tr><th>cause</th><th>p</th><th>estimate</th><th>probability</th>
<th>identifiability</th></tr>
{% for h in f.hypotheses %}<tr><td title="{{ h.description }} ({{ h.source }})">
{{ cause(h.name, h.component) }}</td><td class="n">{{ "%.3f"|format(h.p_value) }}</td>
<td>{% if h.estimate is not none %}{{ estimate(h) }}{% if not h.fitted %} (one step){% endif %}
{% if h.at_bound %}, at the end of its range{% endif %}{% else %}-{% endif %}</td>
<td class="n">{{ "%.2f"|format(h.probability) }}</td>
<td>{{ h.why }}{% if h.fraction_simulated < 1 %}; {{ "%.0f"|format(100 * h.fraction_simulated) }}
% of its simulations converged{% endif %}</td></tr>{% endfor %}</table>
<p class="small">p: score test of this cause alone, with what changes of stiffness can explain
projected out, calibrated over the whole catalogue by parametric bootstrap; the smallest
possible value is {{ "%.2g"|format(f.least_p_value) }}. Probability: summed over all sets that
contain the cause.</p>

{% if images.parameters %}<h2>How much: the new parameter</h2>
<img alt="Posterior of the parameters" src="{{ images.parameters }}">
<p class="small">Posterior given the other causes of its sets; dotted: 95 % interval; vermillion:
what the model assumes; thick black: ends of the plausible range.</p>
{% endif %}

<h2>What it changes: stiffness</h2>
<img alt="Stiffness before and after" src="{{ images.theta }}">
{% if f.remaining and changed %}<p>{{ changed }}</p>{% endif %}

{% if f.limits %}<h2>Limits of these data</h2><ul>
{% for s in f.limits %}<li>{{ s }}</li>{% endfor %}</ul>{% endif %}
</body></html>
"""

FAMILIES = {
    "overall": "all residuals together",
    "channel": "single channels",
    "direction": "strain directions",
    "level": "levels, direction by direction",
    "wall": "walls, direction by direction",
}


def write_report(
    findings: str | Path, page: str | Path, residuals: str | Path, table: str | Path
) -> None:
    """Draw the figures and write the page.

    findings: findings.json. It has every number of the page. residuals, table: figure (PNG)
    of the residuals and its data (CSV); the other figures and their data are written beside them.
    """
    content, folder = read_findings(findings), Path(residuals).parent
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {}
    for name in ("residuals", "causes", "parameters", "theta"):
        png = Path(residuals) if name == "residuals" else folder / f"{name}.png"
        csv = Path(table) if name == "residuals" else png.with_suffix(".csv")
        getattr(figures, f"draw_{name}")(content, png, csv)
        drawn[name] = embedded(png) if png.exists() else ""
    moved = [t for t in content["theta"] if abs(t["shift_sd"]) > 1]
    changed = "; ".join(
        f"{t['parameter']} goes from {t['before'][0]:.2f} to {t['after'][0]:.2f}" for t in moved
    )
    quiet = not content["misfit"]["detected"]
    template = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    html = template.from_string(PAGE).render(
        f=content,
        images=drawn,
        families=FAMILIES,
        cause=words.cause,
        estimate=words.estimate,
        number=words.number,
        farthest=words.FARTHEST,
        changed=f"By more than one posterior sd: {changed}." if changed else "",
        colour="#009E73" if quiet else "#D55E00",
    )
    Path(page).write_text(html)


def embedded(png: str | Path) -> str:
    """A picture as the address of itself, for a page that needs no other file."""
    return "data:image/png;base64," + base64.b64encode(Path(png).read_bytes()).decode()
