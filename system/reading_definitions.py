"""Definitions of the readings; `measures.measure` explains them.

The numbers are conventions, not results, so the reference solver and the measures may share them.
"""

SETTLING_BAND = 0.01  # of A: half width of the settling band where a scene gives none
RISE_LEVELS = (0.1, 0.9)  # of a channel's own step
SMALL_STEP = 0.05  # of A: a channel with a smaller step has no rise time
LEVEL_SHIFT = 0.005  # of a channel's step: how far rise levels are moved to find a fragile reading
BAND_SHIFT = 0.05  # of the settling band: how far its edge is moved for the same
SHIFTED = {  # which shift makes a reading fragile
    "rise": f"the level shifted by {LEVEL_SHIFT:.1%} of the step",
    "settling": f"the band {BAND_SHIFT:.0%} wider or narrower",
}
FRAGILE = 0.1  # of a time: a change that makes it fragile
FAINT = 1e-5  # of A: a mode with a smaller share does not ring in a channel
