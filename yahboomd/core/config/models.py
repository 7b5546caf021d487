"""The whole configuration, and the values that other rooms derive from it."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from urllib.parse import quote

from pydantic import Field

from yahboomd.core.config.driving import Command, Estop, Faults, Limits
from yahboomd.core.config.hardware import (
    CUSTOM,
    PRESETS,
    Board,
    Chassis,
    Guard,
    Imu,
    MotorEntry,
    Serial,
    preset_motors,
)
from yahboomd.core.config.outputs import BlackBox, Log, Odometry, Ros2, Web, Zenoh
from yahboomd.core.config.values import Section
from yahboomd.core.drive import arbitration
from yahboomd.core.drive.kinematics import KINEMATICS, STEERING_MAX_RAD, unit_geometry
from yahboomd.core.model import Kinematics, Motor
from yahboomd.core.protocol.profiles import EDGES_PER_LINE, PROFILES, MotorProfile
from yahboomd.core.protocol.registry import check_storable
from yahboomd.core.protocol.settings import BoardSettings

CALIBRATION = "calibration.toml"
"""The name of the calibration file in the state directory."""

BLACKBOX = "blackbox"
"""The name of the folder of black boxes in the state directory."""

USUAL_LINES = 11
"""Encoder lines of the motors that are sold with the board."""


class Config(Section):
    """The configuration of one robot; everything has a default."""

    serial: Serial = Field(default=Serial(), description="The serial port.")
    guard: Guard = Field(default=Guard(), description="The guard.")
    board: Board = Field(default=Board(), description="The board.")
    chassis: Chassis = Field(default=Chassis(), description="The chassis.")
    imu: Imu = Field(default=Imu(), description="The inertial sensor.")
    limits: Limits = Field(default=Limits(), description="The limits.")
    command: Command = Field(default=Command(), description="The commands.")
    odometry: Odometry = Field(default=Odometry(), description="The odometry.")
    zenoh: Zenoh = Field(default=Zenoh(), description="The bus.")
    ros2: Ros2 = Field(default=Ros2(), description="The ROS 2 plane.")
    faults: Faults = Field(default=Faults(), description="The faults.")
    estop: Estop = Field(default=Estop(), description="The emergency stop.")
    blackbox: BlackBox = Field(default=BlackBox(), description="The black box.")
    web: Web = Field(default=Web(), description="The page for the phone.")
    log: Log = Field(default=Log(), description="The log.")

    def resolved(self) -> Config:
        """The same with the preset's kinematics and motors written out."""
        kinematics, motors = self.kinematics_name(), self.motor_entries()
        chassis = {"kinematics": kinematics, "motors": motors}
        return self.model_copy(update={"chassis": self.chassis.model_copy(update=chassis)})

    def kinematics_name(self) -> str:
        chassis = self.chassis
        return PRESETS[chassis.preset][0] if chassis.preset else chassis.kinematics

    def motor_entries(self) -> dict[str, tuple[MotorEntry, ...]]:
        return preset_motors(self.chassis) if self.chassis.preset else self.chassis.motors

    def kinematics(self) -> Kinematics:
        chassis = self.chassis
        return KINEMATICS[self.kinematics_name()](
            separation_m=chassis.wheel_separation_m * chassis.wheel_separation_multiplier,
            base_m=chassis.wheel_base_m,
            steering_max_rad=chassis.steering_max_rad or STEERING_MAX_RAD,
            sideways=chassis.sideways_multiplier,
        )

    def profile(self) -> MotorProfile:
        """The motors' profile: the vendor's by name, or the figures of ``custom``.

        Raises:
            ConfigError: If a custom profile cannot be stored on the board.
        """
        board, chassis = self.board, self.chassis
        if board.profile != CUSTOM:
            return PROFILES[board.profile]
        lines = board.lines or USUAL_LINES
        ratio = board.ratio or (chassis.ticks_per_revolution or 0.0) / (lines * EDGES_PER_LINE)
        stored: BoardSettings = {"motor_type": board.motor_type or 1}
        if board.deadzone is not None:
            stored["deadzone"] = board.deadzone
        custom = MotorProfile(
            name=CUSTOM,
            stored=stored,
            lines=lines,
            ratio=ratio,
            wheel_diameter_mm=board.wheel_diameter_mm or 2000.0 * (chassis.wheel_radius_m or 0.0),
        )
        check_storable(custom.settings)
        return custom

    def radius_m(self, wheel: str) -> float:
        nominal = self.chassis.wheel_radius_m or self.profile().wheel_radius_m
        return nominal * self.chassis.wheel_radius_multiplier.get(wheel, 1.0)

    def ticks_per_revolution(self) -> float:
        return self.chassis.ticks_per_revolution or self.profile().ticks_per_revolution

    def motors(self) -> tuple[Motor, ...]:
        names = self.motor_names()
        return tuple(
            Motor(
                name=names[wheel][number],
                wheel=index,
                position=entry.position,
                command_sign=entry.command_sign,
                encoder_sign=entry.encoder_sign,
                radius_m=self.radius_m(wheel),
                ticks_per_revolution=self.ticks_per_revolution(),
            )
            for index, wheel in enumerate(unit_geometry(self.kinematics_name()).wheels)
            for number, entry in enumerate(self.motor_entries().get(wheel, ()))
        )

    def motor_names(self) -> dict[str, tuple[str, ...]]:
        return {
            wheel: tuple(
                entry.name or (wheel if len(entries) == 1 else f"{wheel}_{number}")
                for number, entry in enumerate(entries, start=1)
            )
            for wheel, entries in self.motor_entries().items()
        }

    def sources(self) -> tuple[arbitration.AllowedSource, ...]:
        return tuple(
            arbitration.AllowedSource(
                name=name, priority=source.priority, timeout_s=self.source_timeout_s(name)
            )
            for name, source in self.command.sources.items()
        )

    def source_timeout_s(self, source: str) -> float:
        return self.command.sources[source].timeout_s or self.command.timeout_s

    def joint_name(self, motor: str) -> str:
        return self.ros2.joint_names.get(motor, f"{motor}_wheel_joint")

    def key(self, key: str) -> str:
        return f"{self.zenoh.namespace}/{key}" if self.zenoh.namespace else key

    def latch_path(self, environ: Mapping[str, str], *, user_id: int) -> Path:
        """The file that keeps an engaged emergency stop over a restart.

        Robots that share a machine differ by their namespace or their port.
        """
        if self.estop.latch_file:
            return Path(self.estop.latch_file)
        name, port = "estop", quote(self.serial.port, safe="")
        if self.zenoh.namespace:
            name += f".{quote(self.zenoh.namespace, safe='')}"
        if port:
            # A file's name has 255 bytes at most.
            name += f"@{port if len(port) <= 120 else sha256(port.encode()).hexdigest()}"
        return runtime_folder(environ, user_id=user_id) / name


def runtime_folder(environ: Mapping[str, str], *, user_id: int) -> Path:
    """The folder of the emergency stop's file and of the local socket.

    Args:
        environ: For ``RUNTIME_DIRECTORY`` (the service manager's) and ``XDG_RUNTIME_DIR``.
    """
    if given := environ.get("RUNTIME_DIRECTORY", "").split(":")[0]:
        return Path(given)
    if user_id == 0:
        return Path("/run/yahboomd")
    if session := environ.get("XDG_RUNTIME_DIR"):
        return Path(session) / "yahboomd"
    return Path(f"/tmp/yahboomd-{user_id}")  # noqa: S108 - checked before it is used


def calibration_path(
    config: Config, environ: Mapping[str, str], path: Path | None, *, user_id: int
) -> Path | None:
    """The calibration file of a configuration; None without a state directory."""
    if config.chassis.calibration_file:
        return Path(config.chassis.calibration_file)
    folder = state_folder(environ, path, user_id=user_id)
    return None if folder is None else folder / CALIBRATION


def blackbox_folder(
    config: Config, environ: Mapping[str, str], path: Path | None, *, user_id: int
) -> Path | None:
    """The folder of the saved black boxes; None without a state directory."""
    if config.blackbox.folder:
        return Path(config.blackbox.folder)
    folder = state_folder(environ, path, user_id=user_id)
    return None if folder is None else folder / BLACKBOX


def state_folder(environ: Mapping[str, str], path: Path | None, *, user_id: int) -> Path | None:
    """The state directory; None if there is none.

    Args:
        environ: For ``STATE_DIRECTORY`` (the service manager's), ``XDG_STATE_HOME`` and ``HOME``.
        path: The configuration file; one below /etc/yahboomd is that of a service.
    """
    if given := environ.get("STATE_DIRECTORY", "").split(":")[0]:
        return Path(given)
    if path is not None and path.parent == Path("/etc/yahboomd"):
        instance = "" if path.stem == "config" else f"-{path.stem}"
        return Path(f"/var/lib/yahboomd{instance}")
    if user_id == 0:
        return Path("/var/lib/yahboomd")
    if state := environ.get("XDG_STATE_HOME"):
        return Path(state) / "yahboomd"
    if home := environ.get("HOME"):
        return Path(home) / ".local/state/yahboomd"
    return None
