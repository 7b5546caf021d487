"""Faults of clients, daemon, board, line and motors: their injection and required consequences."""

from __future__ import annotations

import os
import signal
import time

from benchmarks.soak.course import BRAKE_S, NEAR_ZERO, Course
from benchmarks.soak.processes import WATCHDOG_S, Helper
from benchmarks.soak.tail import Order, is_stop
from yahboomd.blackbox.ring_file import ring_folder, rings
from yahboomd.core.config import runtime_folder

TIMEOUT_S = 0.5
RAMP_S = 0.25
SILENT_S = 1.0
"""After this time without counts the link gives a board up."""
CONNECT_S = 3.0
NOISY_S = 10.5
"""From the return of a port to a stopped board: the back-off, and the handshake's stop."""


def estop(course: Course) -> None:
    """Engage the emergency stop, against an application that drives on."""
    course.move()
    engage(course, "e-stop")
    reply = course.app.ask("yahboomd/estop/reset")
    if reply is None or reply.success:
        course.fail("the e-stop was released while an application commanded motion")


def engage(
    course: Course,
    kind: str,
    *,
    taken_ns: int | None = None,
    within_s: float = BRAKE_S,
    attachment: bytes | None = None,
) -> None:
    """Press the e-stop, and verify the consequences.

    Args:
        course: The robot.
        kind: The kind of the measured latency.
        taken_ns: When the port takes output again, if it does not now: the latency starts there.
        within_s: The time in which the wheels must stand.
        attachment: An attachment of the sample.
    """
    since_ns = time.monotonic_ns()
    course.app.session.put("yahboomd/estop", b"", attachment=attachment)
    since_ns = max(since_ns, taken_ns or 0)
    course.wait(lambda: time.monotonic_ns() >= since_ns, 5.0)
    course.frame(kind, since_ns, wait_s=5.0)
    stood_ns = course.stands(since_ns, within_s)
    if stood_ns is not None:
        course.stays(stood_ns, 0.4)
    if not course.wait(lambda: (s := course.app.status) and s.state == "estopped", 3.0):
        course.unexpected("the status does not tell of the e-stop")


def silence(course: Course) -> None:
    """Stop sending in motion."""
    course.move()
    _lapse(course, "command silence", course.app.silent())


def _lapse(course: Course, kind: str, last_ns: int) -> None:
    steady = course.board.wire.last_before(last_ns)
    most = steady.largest if steady is not None else 0

    def slower(order: Order) -> bool:
        return order.largest < most

    course.frame(kind, last_ns, slower, wait_s=5.0)
    course.stands(last_ns, TIMEOUT_S + RAMP_S + BRAKE_S)


def client_killed(course: Course) -> None:
    """Kill an application in motion."""
    course.app.silent()
    helper = Helper("drive", course.endpoint, "cmd_vel", "0.35", "-0.4")
    try:
        helper.wait_ready()
        began_ns = time.monotonic_ns()
        if not course.wait(lambda: course.board.truth.travelled_m(began_ns) > 0.1, 10.0):
            course.unexpected("another application cannot drive")
    finally:
        helper.kill()
    _lapse(course, "client killed", int(helper.lines[-1]))


def flood(course: Course) -> None:
    """Flood from several applications, and engage an e-stop among them."""
    kinds = course.random.sample(["garbage", "large", "valid=0.35", "garbage"], k=2)
    course.move(0.35, 0.0)
    helpers = [Helper("flood", course.endpoint, "cmd_vel", kind) for kind in kinds]
    try:
        for helper in helpers:
            helper.wait_ready()
        time.sleep(1.0)
        engage(course, "e-stop in a flood")
    finally:
        for helper in helpers:
            helper.kill()


def sigterm(course: Course) -> None:
    """Stop the service, as a shutdown does; the manager starts it again."""
    course.move()
    life = course.manager.life
    number = course.random.choice([signal.SIGTERM, signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
    since_ns = course.manager.signal(number)
    course.frame("SIGTERM", since_ns, wait_s=5.0)
    course.stands(since_ns, BRAKE_S + 0.1)
    if not course.wait(lambda: life.status is not None, 10.0) or life.status != 0:
        course.unexpected(f"the daemon ended with {life.status}")


def sigkill(course: Course) -> None:
    """Kill the daemon; the manager's next command stops the wheels."""
    course.move()
    since_ns = course.manager.signal(signal.SIGKILL)
    course.frame("SIGKILL", since_ns, wait_s=10.0)
    course.stands(since_ns, 1.0 + BRAKE_S)


def damaged_rings(course: Course) -> None:
    """Kill it, and put two damaged rings beside its own: the next daemon still drives."""
    user_id = os.getuid()
    folder = ring_folder(runtime_folder(os.environ, user_id=user_id), user_id)
    whole = next((path.read_bytes() for path in rings(folder)), b"")
    flipped = bytearray(whole[:4096] or b"?")
    for _ in range(8):
        flipped[course.random.randrange(len(flipped))] ^= 1 << course.random.randrange(8)
    damaged = [folder / f"soak-{os.getpid()}-{number}.ring" for number in range(2)]
    for path, data in zip(damaged, (bytes(flipped), course.random.randbytes(4096)), strict=True):
        path.write_bytes(data)
    try:
        sigkill(course)
        time.sleep(1.0)
    finally:
        for path in damaged:
            path.unlink(missing_ok=True)


def recorders_fail(course: Course) -> None:
    """Make each recorder raise, one after the other: it drives, and stops at an e-stop."""
    course.move()
    since_ns = time.monotonic_ns()
    fuse = course.manager.fuse
    fuse.touch()
    try:
        if not course.wait(
            lambda: (s := course.app.status) and s.command["recorder_failures"], 5.0
        ):
            course.unexpected("no recorder is switched off")
        course.move()
        engage(course, "e-stop")
    finally:
        fuse.unlink()
    if course.manager.life.began_ns > since_ns:
        course.fail("a recorder ended the daemon")
    # The next daemon has all of its recorders again.
    life = course.manager.life
    course.manager.signal(signal.SIGTERM)
    if not course.wait(lambda: life.status is not None, 10.0) or life.status != 0:
        course.unexpected(f"the daemon ended with {life.status}")


def sigstop(course: Course) -> None:
    """Hang the daemon; the watchdog ends it."""
    course.move()
    kills = course.manager.watchdog_kills
    since_ns = course.manager.signal(signal.SIGSTOP)
    # Frames written before the signal are no stop.
    course.frame("SIGSTOP", since_ns, wait_s=10.0)
    course.stands(since_ns, WATCHDOG_S + 1.0 + BRAKE_S)
    if course.manager.watchdog_kills == kills:
        course.unexpected("the watchdog did not act")


def reset(course: Course) -> None:
    """Reset the board in motion."""
    course.move()
    _counts_from_zero(course)
    _after_reset(course, course.board.do("reset"))


def brown_out(course: Course) -> None:
    """Interrupt the board's supply for a moment."""
    course.move()
    _counts_from_zero(course)
    off_s = course.random.choice([0.02, 0.1, 0.4])
    _after_reset(course, course.board.do(f"brown-out {off_s}"))


def dip(course: Course) -> None:
    """Dip the supply until after a stop was due: no wheel is accused."""
    course.move()
    _counts_from_zero(course)
    since_ns = course.board.do(f"brown-out {course.random.choice([0.3, 0.6, 0.8])}")
    course.stands(since_ns, 1.0)
    time.sleep(2.0)
    if course.app.events_since(since_ns, "stop_not_obeyed"):
        course.unexpected("a wheel is accused of disobeying a stop", since_ns)


def _counts_from_zero(course: Course) -> None:
    course.resets += 1
    if course.resets > 1 and not course.streamed:
        course.apart = NEAR_ZERO


def _after_reset(course: Course, since_ns: int) -> None:
    stood_ns = course.stands(since_ns, 1.0)
    if course.announces and stood_ns is not None:
        # It stands for a second from the board's report on.
        rest_s = 0.95 - (stood_ns - since_ns) / 1e9
        course.stays(stood_ns, max(0.0, rest_s))


def reset_loop(course: Course) -> None:
    """Reset the board again and again."""
    if not course.announces:
        # Such a board does not report its resets.
        brown_out(course)
        return
    course.move()
    for _ in range(3):
        since_ns = course.board.do("brown-out 0.05")
        time.sleep(1.2)
    if not course.wait(lambda: (s := course.app.status) and s.state == "fault", 3.0):
        course.unexpected("three resets are no fault")
    course.stands(since_ns, 1.0)


def board_hangs(course: Course) -> None:
    """Hang the board's processor with its motors on; only its supply can stop them."""
    course.move(0.2, 0.0)
    _counts_from_zero(course)
    course.board.do("hang")
    time.sleep(course.random.uniform(0.3, 2.0))
    course.stands(course.board.do("brown-out 0.2"), 1.0)


def mute_short(course: Course) -> None:
    """Lose the board's output for a moment."""
    course.app.wander()
    time.sleep(0.5)
    course.board.do(f"mute {course.random.uniform(0.05, 0.7):.3f}")
    time.sleep(1.5)


def mute_long(course: Course) -> None:
    """Lose the board's output for a while."""
    course.move()
    since_ns = course.board.do("mute 2.5")
    course.stands(since_ns, SILENT_S + BRAKE_S + 0.2)
    time.sleep(1.0)


def babble(course: Course) -> None:
    """Deliver random bytes instead of the board's output."""
    course.move()
    for_s = course.random.choice([0.2, 0.6, 2.2])
    since_ns = course.board.do(f"babble {for_s}")
    if for_s > SILENT_S:
        course.stands(since_ns, SILENT_S + BRAKE_S + 0.5)
    else:
        time.sleep(for_s)
    time.sleep(1.0)
    course.damaged_ns = time.monotonic_ns()


def unplug_short(course: Course) -> None:
    """Unplug the cable for less than a second."""
    _unplug(course, course.random.uniform(0.05, 0.8))


def unplug_long(course: Course) -> None:
    """Unplug it for seconds: the wheels turn on, and are stopped when it is back."""
    _unplug(course, course.random.uniform(2.0, 4.0))


def _unplug(course: Course, for_s: float) -> None:
    course.move(0.25, 0.5)
    since_ns = course.board.do(f"unplug {for_s:.3f}")
    back_ns = since_ns + round(for_s * 1e9)
    if lapses := for_s > 1.0 or course.random.random() < 0.5:
        course.app.silent()
    course.wait(lambda: time.monotonic_ns() > back_ns, for_s + 1.0)
    course.frame("unplug: from the replug", back_ns, is_stop, wait_s=10.0)
    # A source that keeps commanding drives on, so the wheels need not stand in between.
    if lapses:
        course.stands(back_ns, CONNECT_S)


def loss(course: Course) -> None:
    """Lose bytes, up to one in five; it must still stop."""
    share = course.random.choice([0.01, 0.05, 0.2])
    _noise(course, f"loss {share}")


def corruption(course: Course) -> None:
    """Change bytes."""
    share = course.random.choice([0.001, 0.01, 0.05])
    _noise(course, f"corruption {share}")


def jitter(course: Course) -> None:
    """Deliver bytes late and unevenly."""
    _noise(
        course, f"delay {course.random.choice([0.0, 0.01])} {course.random.choice([0.01, 0.04])}"
    )


def _noise(course: Course, command: str) -> None:
    course.app.wander()
    course.board.do(command)
    time.sleep(course.random.uniform(1.0, 3.0))
    course.stands(course.app.silent(), TIMEOUT_S + RAMP_S + BRAKE_S + 2.0)
    course.board.do("clear")
    course.damaged_ns = time.monotonic_ns()


def encoder_dead(course: Course) -> None:
    """Stop an encoder's counts: the board's loop runs away."""
    _lies(course, "encoder-dead")


def encoder_reversed(course: Course) -> None:
    """Reverse an encoder's counts: the board's loop runs away."""
    _lies(course, "encoder-reversed")


def motor_unplugged(course: Course) -> None:
    """Unplug a motor."""
    _lies(course, "unplugged")


def stalled(course: Course) -> None:
    """Hold a wheel."""
    _lies(course, "stalled", honest=True)


def _on_a_clean_line(course: Course) -> None:
    """Wait until the line is no longer blamed for a wheel's motion."""
    course.wait(lambda: time.monotonic_ns() - course.damaged_ns > NOISY_S * 1e9, NOISY_S)


def _lies(course: Course, fault: str, *, honest: bool = False) -> None:
    _on_a_clean_line(course)
    wheel = course.random.choice(["left", "right"])
    # At least as fast as the checks require.
    speed = course.random.choice([0.15, 0.35]) * course.random.choice([1, -1])
    course.move(speed, 0.0, for_s=1.0)
    if not honest:
        course.apart = "an encoder lied"
    since_ns = course.board.do(f"{fault} {wheel}")
    course.frame(f"{fault}: to the cut", since_ns, is_stop, wait_s=5.0)
    course.stands(since_ns, 1.6)
    if not course.wait(lambda: (s := course.app.status) and s.state == "fault", 3.0):
        course.unexpected(f"{fault} {wheel} is no fault")
    course.board.do(f"repair {wheel}")


def turning(course: Course) -> None:
    """Turn a wheel by hand: slow turning is reported, turning beyond the margin is a fault."""
    _on_a_clean_line(course)
    # Drive first: after a crawl without rolling the motors are let go, and may turn freely.
    course.move(0.25, 0.0)
    silent_ns = course.app.silent()
    course.stands(silent_ns, TIMEOUT_S + RAMP_S + BRAKE_S, "command silence")
    course.wait(lambda: (s := course.app.status) and s.state == "standing", 3.0)
    speed, kind = course.random.choice([(0.07, "turns_without_command"), (0.2, "runaway_fast")])
    since_ns = course.board.do(f"turning left {speed}")
    if not course.wait(lambda: course.app.events_since(since_ns, kind), 3.0):
        course.unexpected(f"{kind} is not reported", since_ns)
    course.stands(course.board.do("repair left"), BRAKE_S)
