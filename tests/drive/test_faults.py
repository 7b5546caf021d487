from __future__ import annotations

import pytest

from yahboomd.core.drive.faults import Action, Fault


def test_a_fault_becomes_an_event_that_names_the_wheel() -> None:
    event = Fault(
        kind="no_counts",
        motor="left",
        message="left stands.",
        action="policy",
        commanded_m_s=0.30004,
        measured_m_s=0.10004,
    ).event()
    assert (event.kind, event.severity, event.wheel) == ("no_counts", "error", "left")
    assert event.message == "left stands."
    assert event.data == {"commanded_m_s": 0.3, "measured_m_s": 0.1}


@pytest.mark.parametrize(
    ("action", "severity"), [("cut", "error"), ("policy", "error"), ("report", "warning")]
)
def test_what_is_only_reported_is_a_warning(action: Action, severity: str) -> None:
    fault = Fault(kind="off_speed", motor="left", message="left is slow.", action=action)
    assert fault.event().severity == severity


def test_a_fault_of_all_motors_names_none() -> None:
    fault = Fault(kind="no_counts", motor=None, message="All stand.", action="policy")
    assert fault.event().wheel is None
    assert fault.event().data == {"commanded_m_s": 0.0, "measured_m_s": 0.0}
    assert not fault.certain
