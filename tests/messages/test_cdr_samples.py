"""The golden samples of ROS 2's messages are correct."""

from __future__ import annotations

import pytest

from make.schema_files.cdr_samples import CDR


@pytest.mark.parametrize("name", CDR)
def test_every_sample_equals_rosbags(oracle, name):
    sample = CDR[name]
    little_endian = "big_endian" not in name
    assert sample.payload == oracle.encode(
        sample.ros_type, sample.values, little_endian=little_endian
    )
