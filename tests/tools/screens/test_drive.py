from __future__ import annotations

import subprocess
from collections.abc import Callable

import pytest

from yahboomd.cli.main import main


@pytest.mark.realtime
def test_without_a_terminal_it_refuses_in_a_sentence(
    yahboomd: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    done = yahboomd("drive")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("yahboomd: drive needs a terminal")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("speed", ["0", "-1", "nan", "inf", "1e39", "fast"])
def test_a_speed_must_be_a_number_above_zero(
    capsys: pytest.CaptureFixture[str], speed: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["drive", f"--linear={speed}"])
    assert ended.value.code == 2
    assert f"--linear: {speed} is not a speed above 0, up to 100 m/s" in capsys.readouterr().err
