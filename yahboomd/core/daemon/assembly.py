"""Builds objects from the configuration: the only place that knows both."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Mapping
from pathlib import Path

from yahboomd.core.bus.options import BusOptions
from yahboomd.core.clock import Clock
from yahboomd.core.config import Config, runtime_folder
from yahboomd.core.daemon.estop.latch import EstopLatch
from yahboomd.core.daemon.estop.latch_file import LatchFile
from yahboomd.core.daemon.fit import BLIND_S, ControlOptions
from yahboomd.core.daemon.folder import prepare_folder
from yahboomd.core.daemon.supervisor import storing_opener
from yahboomd.core.drive.arbiter import Arbiter
from yahboomd.core.errors import PortBusy
from yahboomd.core.link import port_note
from yahboomd.core.link.connected_board import Listener
from yahboomd.core.link.discovery import candidates, find
from yahboomd.core.link.port import Opener, Port, PortOptions, SerialPort, open_port
from yahboomd.core.link.port_guard import PortGuard
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.session import Session, SessionOptions
from yahboomd.core.link.tap import NO_TAP, Tap
from yahboomd.core.odometry.heading import CALIBRATED
from yahboomd.core.odometry.odometer import OdometerSettings
from yahboomd.core.program import release_command
from yahboomd.core.protocol.profiles import TYPES
from yahboomd.core.standstill import STANDING_M_S

log = logging.getLogger(__name__)

LONGEST_PERIOD_S = 0.1
"""Steps also repeat stops, cut wheels that do not obey them, and notice missing counts."""

NOTED_WITHIN_S = 0.1
"""The longest that the first stop on a port waits for the note of how it was opened."""


def bus_options(config: Config) -> BusOptions:
    zenoh = config.zenoh
    return BusOptions(
        mode=zenoh.mode,
        listen=zenoh.listen,
        connect=zenoh.connect,
        namespace=zenoh.namespace,
        config_file=Path(zenoh.config) if zenoh.config else None,
        gossip=config.ros2.rmw_zenoh,
    )


def arbiter(config: Config) -> Arbiter:
    command = config.command
    return Arbiter(config.sources(), on_timeout=command.on_timeout, stamps=command.stamps)


def odometer_settings(config: Config) -> OdometerSettings:
    return OdometerSettings(
        kinematics=config.kinematics(),
        motors=config.motors(),
        speed_max_m_s=config.odometry.max_wheel_speed_m_s,
        noise_m=config.odometry.noise_m,
        fused=config.odometry.heading == "fused",
        gyro_scale=None if config.imu.gyro_scale is None else CALIBRATED,
    )


def control_options(config: Config) -> ControlOptions:
    return ControlOptions(
        kinematics=config.kinematics(),
        motors=config.motors(),
        profile=config.profile(),
        command_scale=config.chassis.command_scale,
        linear=config.limits.linear.noun(),
        angular=config.limits.angular.noun(),
        at_rest=config.command.at_rest,
        stall=config.faults.stall,
        turns_without_command=config.faults.turns_without_command,
        min_speed_m_s=config.faults.min_speed_m_s,
        period_s=min(1.0 / config.command.rate_hz, LONGEST_PERIOD_S),
        blind_s=max(BLIND_S, 3.0 / config.odometry.poll_rate_hz),
        release=release_command(config.zenoh.namespace, config.zenoh.listen),
        mounting=config.imu.mounting(),
        battery_scale=config.board.battery_scale,
        battery_low_v=config.board.low_v(),
        battery_stop_v=config.board.battery_stop_v,
    )


def latch(config: Config, clock: Clock, environ: Mapping[str, str]) -> EstopLatch:
    path = config.latch_path(environ, user_id=os.getuid())
    port = None if config.estop.latch_file else config.serial.port
    release = release_command(config.zenoh.namespace, config.zenoh.listen)
    return EstopLatch(LatchFile(path, port=port), clock.now_ns(), release=release)


def opener(
    config: Config,
    clock: Clock,
    environ: Mapping[str, str] | None = None,
    guard: PortGuard | None = None,
) -> Opener:
    """Looks for the port at each attempt: a board that comes back may be elsewhere.

    Args:
        environ: Has the folder for the note on the open port, for the stop after a kill.
        guard: Each port is shared with it.
    """
    serial = config.serial
    noting: threading.Thread | None = None
    said = ""

    def options_of(path: str) -> PortOptions:
        return PortOptions(
            path=path,
            baudrate=serial.baudrate,
            dtr=serial.dtr,
            rts=serial.rts,
            hangup_on_close=serial.hangup_on_close,
            relay=config.guard.relay,
        )

    async def taken(path: str) -> SerialPort:
        try:
            return await open_port(options_of(path), clock)
        except PortBusy:
            if guard is not None:
                guard.want(path)
            raise

    async def open_it() -> Port:
        nonlocal noting, said
        if guard is not None:
            guard.close_port()
        found = candidates() if not serial.port else ()
        path, words = await find(serial.port, found, taken, clock)
        if words not in {"", said}:
            said = words
            log.info("%s", words)
        port = await taken(path)
        note = port.share(guard or PortGuard(), options_of(path))
        if environ is not None and (noting is None or not noting.is_alive()):
            # A disk that hangs holds up no stop, and one thread at most.
            noting = threading.Thread(
                target=_note,
                args=(note, config, environ),
                name="port-note",
                daemon=True,
            )
            with contextlib.suppress(RuntimeError):
                noting.start()
                noting.join(NOTED_WITHIN_S)
        return port

    return open_it


def _note(note: PortNote, config: Config, environ: Mapping[str, str]) -> None:
    folder = runtime_folder(environ, user_id=os.getuid())
    zenoh, latch = config.zenoh, config.latch_path(environ, user_id=os.getuid()).absolute()
    note = note._replace(namespace=zenoh.namespace, listen=tuple(zenoh.listen), latch=str(latch))
    try:
        prepare_folder(folder)
    except OSError:
        # It is another user's.
        return
    port_note.write(note, str(folder))


def session_options(config: Config) -> SessionOptions:
    finest_m = min(motor.metres_per_tick for motor in config.motors())
    return SessionOptions(
        dialect=config.serial.dialect,
        poll_rate_hz=config.odometry.poll_rate_hz,
        resend_s=config.command.resend_s,
        still_ticks_per_s=STANDING_M_S / finest_m,
        profile=config.profile(),
        battery_period_s=config.board.battery_period_s,
    )


def session(
    config: Config,
    clock: Clock,
    listener: Listener,
    open_it: Opener,
    tap: Tap = NO_TAP,
    *,
    guard: PortGuard | None = None,
) -> Session:
    if config.board.write_settings:
        # A type says which car it is, and only a person knows that: `yahboomd probe --write`.
        want = {
            name: value for name, value in config.profile().settings.items() if name not in TYPES
        }
        open_it = storing_opener(open_it, clock, want, listener.event, tap)
    return Session(open_it, clock, listener, session_options(config), tap, guard=guard)
