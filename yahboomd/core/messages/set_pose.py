"""Reads ROS 2's message that sets the pose, and checks covariances.

Law: from an accepted pose and covariance odometry can continue for ever in finite numbers. The
message limits single numbers (:mod:`.native`); this file checks them against each other.
"""

from __future__ import annotations

import math
import struct

import msgspec

from yahboomd.core.messages import cdr
from yahboomd.core.messages.native import SetPoseRequest
from yahboomd.core.model import Matrix3

_PLANAR = (0, 1, 5, 6, 7, 11, 30, 31, 35)
"""The places of x, y and yaw in a covariance over (x, y, z, roll, pitch, yaw), row by row."""


def decode_pose(payload: bytes, frame_id: str) -> SetPoseRequest | str:
    """Reads a geometry_msgs/msg/PoseWithCovarianceStamped, and uses its planar part.

    Args:
        payload: Header and body, in either byte order.
        frame_id: The frame that its pose has to be in.

    Returns:
        The pose, or the problem with the message.
    """
    if not cdr.is_cdr(payload) or len(payload) < 16:
        return "it is no geometry_msgs/PoseWithCovarianceStamped"
    order = "<" if payload[1] else ">"
    (length,) = struct.unpack_from(f"{order}I", payload, 12)
    # Doubles start at a multiple of eight behind the header.
    body = 4 + (12 + length + 7 & ~7)
    if len(payload) != body + 8 * (7 + 36):
        return "it is no geometry_msgs/PoseWithCovarianceStamped"
    frame = payload[16 : 16 + length].rstrip(b"\0").decode(errors="replace")
    if frame != frame_id:
        return f'its frame is "{frame[:80]}", and a pose in "{frame_id}" is expected'
    numbers = struct.unpack_from(f"{order}43d", payload, body)
    if not all(map(math.isfinite, numbers)):
        return "a number is not finite"
    x, y, _, qx, qy, qz, qw = numbers[:7]
    if abs(math.hypot(qx, qy, qz, qw) - 1.0) > 0.01:
        return "its orientation is no quaternion of length 1"
    xx, xy, xt, yx, yy, yt, tx, ty, tt = (numbers[7 + place] for place in _PLANAR)
    covariance = (xx, xy, xt, yx, yy, yt, tx, ty, tt)
    theta = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    try:
        request = msgspec.convert(
            {"x": x, "y": y, "theta": theta, "covariance": covariance}, SetPoseRequest
        )
    except msgspec.ValidationError as error:
        return str(error)
    return covariance_problem(covariance) or request


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
    # If one pair is too small to have a correlation, some correlation fits the other two.
    known = min(deviations[one] * deviations[other] for one, other in _PAIRS) > NOTHING
    if known and 1.0 + 2.0 * xy * xt * yt - xy * xy - xt * xt - yt * yt < -TOLERANCE:
        return "covariance is not positive semidefinite"
    return None
