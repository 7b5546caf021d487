"""Checks the covariance in a request to set the pose.

Law: from an accepted pose and covariance odometry can continue for ever in finite numbers. The
message limits single numbers (:mod:`.native`); this file checks them against each other.
"""

from __future__ import annotations

import math

from yahboomd.model import Matrix3

TOLERANCE = 1e-6
"""The rounding error of correlations in a matrix written with seven digits."""

NOTHING = 1e-12
"""Smaller covariances count as zero: the encoder tick that odometry adds is more."""

_PAIRS = ((0, 1), (0, 2), (1, 2))


def covariance_problem(covariance: Matrix3) -> str | None:
    """The reason why a matrix is no covariance of (x, y, theta); None if it is one.

    Correlations are checked instead of covariances: metres and radians differ by orders of
    magnitude, and rounding errors are relative to them.

    Args:
        covariance: Row by row, all finite.
    """
    deviations = [math.sqrt(max(0.0, covariance[4 * axis])) for axis in range(3)]
    if any(variance < 0.0 for variance in covariance[::4]):
        return "a variance, on the diagonal of covariance, is negative"
    found = list[float]()
    for one, other in _PAIRS:
        sides = covariance[3 * one + other], covariance[3 * other + one]
        scale = deviations[one] * deviations[other]
        if scale <= NOTHING:
            if max(map(abs, sides)) > NOTHING:
                return "covariance is not positive semidefinite: a variance of zero has no company"
            found.append(0.0)
            continue
        upper, lower = (side / scale for side in sides)
        if not abs(upper - lower) <= TOLERANCE:
            return "covariance is not symmetric"
        found.append(0.5 * (upper + lower))
    xy, xt, yt = found
    if max(map(abs, found)) > 1.0 + TOLERANCE:
        return "covariance is not positive semidefinite: a correlation is beyond 1"
    # Where one pair is too small to have a correlation, some correlation fits the other two.
    known = min(deviations[one] * deviations[other] for one, other in _PAIRS) > NOTHING
    if known and 1.0 + 2.0 * xy * xt * yt - xy * xy - xt * xt - yt * yt < -TOLERANCE:
        return "covariance is not positive semidefinite"
    return None
