"""The motor that the vendor does not list, by its figures."""

from __future__ import annotations

from yahboomd.errors import ConfigError
from yahboomd.protocol.profiles import NO_ENCODER_TYPE, MotorProfile
from yahboomd.protocol.registry import check_storable
from yahboomd.protocol.settings import BoardSettings


def custom_profile(
    *,
    lines: int,
    ratio: float,
    wheel_diameter_mm: float,
    motor_type: int = 1,
    deadzone: int | None = None,
) -> MotorProfile:
    """The profile ``custom``: a motor that the vendor does not list.

    Raises:
        ConfigError: If the board cannot be sent them, or could not count.
    """
    stored: BoardSettings = {"motor_type": motor_type}
    if deadzone is not None:
        stored["deadzone"] = deadzone
    profile = MotorProfile(
        name="custom",
        stored=stored,
        lines=lines,
        ratio=ratio,
        wheel_diameter_mm=wheel_diameter_mm,
    )
    if motor_type == NO_ENCODER_TYPE:
        message = "Motor type 4 has no encoder, so there is nothing to compute odometry from."
        raise ConfigError(message)
    check_storable(profile.settings)
    return profile
