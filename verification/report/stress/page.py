"""The page of the documentation on the stress cases, from a run of all of them."""

from __future__ import annotations

from taction.verification.evidence.stress.run import StressReport
from taction.verification.report.blocks import PAGE
from taction.verification.report.renderers.markdown import markdown
from taction.verification.report.views.stress import view

INTRODUCTION = """\
# Stiff and extreme cases

`taction stress` verifies a catalogue of scenes that are hard for a simulator or for a verdict.
The right outcome and the true readings of every case are known. A run compares every outcome with
the right one, and every stated number with the true number. So a run also shows whether ngspice
and the numerical libraries of a machine give right answers.

```sh
taction stress                        # all cases, on ngspice and on the state-space engine
taction stress --only onset           # one family, or one case
taction stress --junit stress.xml --json > stress.json
```

The exit status is 0 if all is right, 1 if an outcome or a number is wrong, and 3 if ngspice is
missing.

The cases are data: `scenes/stress/*.toml`, one file per family. Each case has the keys of a
scene, why the scene is hard, its right outcome, and how this outcome is known.
`scenes/stress/true-values.json` holds the true readings, which `scripts/stress_truth.py` writes;
the tests compute a sample of them again and compare the deck of every case with the stored one.
Boards with linear amplifiers: the deck's text is read, its poles and modes are computed with 320
bits, and crossings and peaks are found by bounds over intervals. Boards with other amplifiers:
equilibrium and poles with 320 bits, the transient by two integrators of SciPy. The reference
solution is computed from the problem alone, with 320 bits or 60 digits.

A right outcome may be a refusal: the table then has the name of the exception. "Worst quantity"
is the stated number whose true error is largest beside its stated error. "Outside" counts the
numbers whose true error is larger than the stated one. A number is wrong, and the exit status 1,
if its true error exceeds the stated one by more than the error that the scene allows: a quarter of
the tolerance of the steady state, or `analysis.error`, as a fraction of the step amplitude, and
for a time the shift that such an error of an output causes. A check that passes or fails against
its true value is wrong, too.
"""


def stress_page(report: StressReport) -> str:
    """Return a run as a page in Markdown: the table, then every case in words."""
    _, _, results = markdown(view(report), medium=PAGE).partition("\n")
    return INTRODUCTION + results
