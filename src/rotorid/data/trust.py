"""Limits above which data are trusted, shared by an identification and its prediction.

A design says what an identification of its flight will use, drop and refuse. So both read the limits here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rotorid.typing import BoolArray, FloatArray

RICH_KINDS = ("sweep", "random_binary", "multisine")
"""Kinds of maneuvers that are fitted; the others are short, and judge a model."""

DIRECT_COHERENCE = 0.6
"""Least coherence of a point of a direct estimate."""

JOINT_COHERENCE = 0.2
"""Least coherence of a point of a joint estimate, between instrument and output: feedback and other inputs lower that
without harm, and the random error shows how good a point is, down to about this value."""

LARGEST_RANDOM_ERROR = 0.3
"""Largest relative random error of a point."""

SMALL_ERROR = f"an error below {100.0 * LARGEST_RANDOM_ERROR:g} %"
"""The same in words."""

MEANINGLESS_STRUCTURE_ERROR = 0.1
"""Relative model error of a main response above which values follow the data and have no physical meaning; a structure
is judged where this would show."""

LEAST_WIDTH = 2.0
"""Highest over lowest frequency of what a fit needs: below an octave, gain, damping and delay cannot be separated."""

LOWEST_TOP_RAD_S = 8.0
"""A rate model is not identified from data that end below: there the speed modes of the airframe rule."""

ACCEPTABLE_COST = 100.0
"""Average cost up to which a model is acceptable: the guideline of CIFER."""

EXCELLENT_COST = 50.0
"""Average cost up to which a model is practically indistinguishable from the flight: the same guideline."""

CRAMER_RAO_GUIDELINE_PERCENT = 20.0
"""Cramér–Rao bound of CIFER up to which a parameter is usual; above it, it trades against others."""

INSENSITIVITY_GUIDELINE_PERCENT = 10.0
"""Insensitivity of CIFER up to which a parameter is usual; above it, the data barely constrain it."""

BOUNDS_MEANING = (
    "± is the error, one standard deviation. CR and I are not errors but CIFER's scales of how sharply the cost rises: "
    f"Cramér–Rao with all other parameters free (usual up to {CRAMER_RAO_GUIDELINE_PERCENT:g} %), insensitivity with "
    f"all others fixed (usual up to {INSENSITIVITY_GUIDELINE_PERCENT:g} %)."
)
"""Explanation of the three numbers of a parameter and of the limits of two of them."""

FITTED_SHARE = 0.7
"""Share of the requested octaves below which a finding says how little of them could be fitted."""

ROBUSTNESS = 1.7
"""Largest sensitivity peak of a loop that is asked of new gains, unless another one is."""

SAFE_PEAK, SAFE_PHASE_MARGIN_DEG = 2.0, 40.0
"""Sensitivity peak up to which, and phase margin from which, gains that fly are fine: beyond, a loop rings, and has
little left for a heavier day or a weaker battery. What is asked of new gains leaves a reserve to these."""

REFUSED_PEAK, REFUSED_QUANTILE = 2.4, 0.9
"""Sensitivity peak above which gains are not to be flown, and the quantile of the likely plants that counts."""

COMMAND_NOISE = 2.0
"""Noise of the command that is asked of gains at most, as a factor on that of the flown ones."""

REFERENCE_S = 60.0
"""Beginning of a flight that all else is compared with, where a model is followed through it."""

STEP_SHARE = 0.13
"""The change of a gain that is looked for there, 15 % of inertia; larger ones are found sooner."""

CERTAIN_SIGN = 2.0
"""Standard deviations from zero at which the sign of a value is certain."""


def trusted(random_error: FloatArray, coherence: FloatArray, least: float) -> BoolArray:
    """Points of a response that tables count, of the shape of the arrays; pictures draw no other point as one of them.

    Parameters
    ----------
    random_error
        Relative standard deviation of the magnitude.
    coherence
        Same shape.
    least
        The coherence that a point needs, of :func:`least_coherence`.

    Examples
    --------
    >>> import numpy as np
    >>> trusted(np.array([0.1, 0.5, 0.1]), np.array([0.9, 0.9, 0.1]), 0.6)
    array([ True, False, False])
    """
    return (random_error <= LARGEST_RANDOM_ERROR) & (coherence >= least)


def least_coherence(asked: float | None, *, joint: bool) -> float:
    """The coherence that points of an estimate need: the one that was asked for, or that of the kind of estimate.

    Examples
    --------
    >>> least_coherence(None, joint=True), least_coherence(0.8, joint=True)
    (0.2, 0.8)
    """
    if asked is not None:
        return asked
    return JOINT_COHERENCE if joint else DIRECT_COHERENCE
