from __future__ import annotations

import pytest
from pydantic import ValidationError

from yahboomd.core.config.outputs import Log, Odometry, Ros2, Zenoh


def test_the_bus_listens_on_this_machine_only():
    assert Zenoh().listen == ("tcp/127.0.0.1:7448",)
    assert Zenoh().connect == ("tcp/127.0.0.1:7447",)


def test_lists_of_a_file_become_tuples():
    assert Zenoh.model_validate({"listen": ["tcp/[::1]:1"]}).listen == ("tcp/[::1]:1",)


def test_one_endpoint_is_no_list_of_endpoints():
    with pytest.raises(ValidationError):
        Zenoh.model_validate({"listen": "tcp/127.0.0.1:7448"})


def test_the_noise_of_the_odometry_is_the_square_of_a_length():
    assert Odometry(travel_noise_m=0.1).noise_m == pytest.approx(0.01)


@pytest.mark.parametrize("values", [{"domain_id": 233}, {"domain_id": -1}, {"distro": "foxy"}])
def test_what_ros_has_not_is_refused(values):
    with pytest.raises(ValidationError):
        Ros2.model_validate(values)


def test_joints_are_names_without_blanks():
    with pytest.raises(ValidationError):
        Ros2.model_validate({"joint_names": {"left": "left wheel"}})


def test_the_log_says_info_by_default():
    assert Log().level == "info"


def test_a_static_frame_lies_in_its_parent_by_default():
    given = {"static_transforms": [{"parent": "base_link", "child": "laser", "z": 0.1}]}
    (transform,) = Ros2.model_validate(given).static_transforms
    assert (transform.x, transform.y, transform.z, transform.yaw) == (0.0, 0.0, 0.1, 0.0)
