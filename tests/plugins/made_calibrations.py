"""A calibration, and a configuration read with it."""

from __future__ import annotations

from pathlib import Path

from yahboomd.core.config import read
from yahboomd.core.config.calibration_file import Calibration, Multipliers, geometry_of
from yahboomd.core.config.models import Config


def calibration(track: float = 1.05, config: Config | None = None) -> Calibration:
    radii = {"left": 1.01, "right": 1.02}
    return Calibration(
        made="2026-05-04 10:00 UTC",
        method="tape",
        residual="1.1 times what slip and tape explain, 3 runs",
        geometry=geometry_of(config or Config()),
        chassis=Multipliers(wheel_radius_multiplier=radii, wheel_separation_multiplier=track),
        before=Multipliers(
            wheel_radius_multiplier={"left": 1.0, "right": 1.0}, wheel_separation_multiplier=1.0
        ),
    )


def loaded(state: Path, *overrides: str, **environ: str):
    return read(
        None,
        environ={"STATE_DIRECTORY": str(state), **environ},
        overrides=overrides,
        standard_path=state / "none.toml",
    )
