"""What there is to show of a daemon at one moment. Pure nouns."""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from yahboomd.messages.native import PoseSample, StatusSample, TwistSample

STANDING_M_S = 0.005
"""Slower than what a screen's numbers show well."""

LINK_COUNTS: dict[str, tuple[str, ...]] = {
    "lost": ("broken_frames", "overlong", "unrecognised"),
    "discarded bytes": ("discarded_bytes",),
    "refused": ("refusals",),
    "commands lost": ("commands_lost",),
    "missed polls": ("polls_unanswered", "polls_skipped"),
    "missed answers": ("answers_missed",),
    "board resets": ("board_resets",),
    "reconnects": ("disconnected",),
    "late beats": ("polls_late", "beats_missed"),
}
"""Counters of ``status.link`` (and ``status.command``) that are trouble, by what to call them."""

REFUSALS = {
    "no_velocity": "without a velocity",
    "not_finite": "not finite",
    "wrong_type": "of a wrong type",
    "malformed": "malformed",
    "oversize": "too large",
    "unknown_encoding": "in no known encoding",
    "unknown_source": "of unknown sources",
    "stale": "stale",
    "out_of_order": "out of order",
    "from_the_future": "from the future",
    "backlog": "held up",
    "after_pause": "from before a pause",
    "lower_priority": "outranked",
    "not_standing": "too early",
}
"""Reasons for which a command is refused, as counted in ``status.command``, in words."""

Phase: TypeAlias = Literal["waiting", "live", "silent"]


class Count(msgspec.Struct, frozen=True, kw_only=True):
    """A counter of something that should not happen; ``rising`` while it happens."""

    name: str
    total: int
    rising: bool


class WheelView(msgspec.Struct, frozen=True, kw_only=True):
    """One wheel: counts, angle, and its rim's speed beside what was commanded."""

    name: str
    ticks: int
    position_rad: float
    speed_m_s: float
    command_m_s: float


class EventView(msgspec.Struct, frozen=True, kw_only=True):
    """Something that happened, and how long ago."""

    age_s: float
    stamp_ns: int
    severity: str
    message: str


class View(msgspec.Struct, frozen=True, kw_only=True):
    """Everything there is to show at one moment.

    Attributes:
        phase: ``waiting`` until a status came; ``silent`` when they stopped coming.
        silent_s: Since the latest status; None before the first.
        status: The latest status.
        state_s: How long it has been in this state.
        driver_s: How long the driver has had control.
        driver_at_least: It had control before anybody watched: longer than ``driver_s``.
        pose: The latest pose, with ``twist`` and ``wheels``.
        sigma: Standard deviations of x, y (m) and theta (rad), from the covariance.
        late: Pose, twist and wheels are old: they tell the past.
        poses_per_s: As their numbers tell, all of them, whether they arrive here or not.
        full_scale_m_s: The fastest that any wheel was, or was to be, lately.
        volts: Of the battery, where known.
        readings_per_s: Of the board's counters, as the daemon counts them.
        commands_per_s: Commands that the daemon received from anybody.
        link: Troubles of the line.
        refusals: Commands refused, by reason.
        events: The newest last.
        trail: Where it has been, (x, y) in metres, the newest last.
        unreadable: Samples that could not be read.
    """

    phase: Phase
    silent_s: float | None = None
    status: StatusSample | None = None
    state_s: float = 0.0
    driver_s: float = 0.0
    driver_at_least: bool = False
    pose: PoseSample | None = None
    sigma: tuple[float, float, float] | None = None
    twist: TwistSample | None = None
    wheels: tuple[WheelView, ...] = ()
    late: bool = False
    poses_per_s: float | None = None
    full_scale_m_s: float = 0.1
    volts: float | None = None
    readings_per_s: float | None = None
    commands_per_s: float | None = None
    link: tuple[Count, ...] = ()
    refusals: tuple[Count, ...] = ()
    events: tuple[EventView, ...] = ()
    trail: tuple[tuple[float, float], ...] = ()
    unreadable: int = 0

    @property
    def moving(self) -> bool:
        """Whether anything moves, or is to move: a wheel, by command or by measurement."""
        return not self.late and any(
            wheel.command_m_s != 0.0 or abs(wheel.speed_m_s) > STANDING_M_S for wheel in self.wheels
        )
