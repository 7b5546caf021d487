from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.simulation.truth import TruthSample, TruthWriter, pose_at, read_truth


def sample(t_ns: int, x: float = 0.0) -> TruthSample:
    return TruthSample(
        t_ns=t_ns,
        x=x,
        y=0.0,
        theta=-x,
        vx=0.0,
        vy=0.0,
        wz=0.0,
        speed_m_s=(0.1, 0.2),
        travel_m=(1.0, 2.0),
        ticks=(1, 0, -3, 0),
    )


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    writer = TruthWriter(tmp_path / "truth")
    writer.open()
    written = [sample(n * 10_000_000, n / 3) for n in range(50)]
    for one in written:
        writer.write(one)
    writer.close()
    assert read_truth(tmp_path / "truth") == written


def test_a_reader_sees_samples_while_they_are_written_but_no_half_one(tmp_path: Path) -> None:
    path = tmp_path / "truth"
    writer = TruthWriter(path)
    writer.open()
    for n in range(25):
        writer.write(sample(n))
    assert len(read_truth(path)) == 20
    with path.open("ab") as file:
        file.write(b'{"t_ns": 1')
    assert len(read_truth(path)) == 20
    writer.close()


def test_nothing_is_written_after_the_close(tmp_path: Path) -> None:
    writer = TruthWriter(tmp_path / "truth")
    writer.open()
    writer.close()
    writer.close()
    writer.write(sample(1))
    assert read_truth(tmp_path / "truth") == []


def test_between_samples_the_pose_is_interpolated() -> None:
    samples = [sample(0, 0.0), sample(10, 1.0), sample(30, 2.0)]
    assert pose_at(samples, 0).x == 0.0
    assert pose_at(samples, 10).x == 1.0
    assert pose_at(samples, 15).x == 1.25
    assert pose_at(samples, 15).theta == -1.25
    assert pose_at(samples, 30).x == 2.0


@pytest.mark.parametrize("t_ns", [-1, 31])
def test_outside_the_samples_there_is_no_truth(t_ns: int) -> None:
    with pytest.raises(ValueError, match="no truth"):
        pose_at([sample(0), sample(30)], t_ns)
