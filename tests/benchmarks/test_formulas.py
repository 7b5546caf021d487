from __future__ import annotations

import numpy as np
import pytest

from benchmarks.exactness import FINE_TICKS, errors
from benchmarks.formulas import FORMULAS, OURS
from benchmarks.paths import PATHS, random_path, truth


@pytest.mark.parametrize("formula", FORMULAS)
def test_every_formula_is_exact_on_a_straight_line(formula: str) -> None:
    path = truth(PATHS["straight, 50 m"])
    place_mm, heading = errors(path, 20, FINE_TICKS, formula)
    # Single precision loses a millimetre.
    assert place_mm < (1.0 if "float32" in formula else 1e-3)
    assert heading < 1e-3


def test_the_arcs_are_exact_on_a_circle_and_the_others_are_not() -> None:
    path = truth(PATHS["circle R 0.5 m, 50 m"])
    found = {formula: errors(path, 10, FINE_TICKS, formula)[0] for formula in FORMULAS}
    assert found[OURS] < 1e-3
    assert found["arc (diff_drive_controller)"] < 1e-3
    assert found["midpoint (the article)"] == pytest.approx(0.42, abs=0.01)
    assert found["Euler, float32 (linorobot2)"] == pytest.approx(50.0, abs=1.0)


def test_true_travel_and_true_place_belong_together() -> None:
    path = truth(random_path(3))
    steps = np.hypot(np.diff(path.x), np.diff(path.y))
    rolled = np.abs(np.diff(path.left + path.right)) / 2.0
    assert np.allclose(steps, rolled, atol=1e-6)
