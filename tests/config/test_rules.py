from __future__ import annotations

import pytest

from yahboomd.core.config.models import Config
from yahboomd.core.config.rules import RULES, findings
from yahboomd.core.config.values import dotted

MECANUM = {
    "front_left": [{"position": 1}],
    "rear_left": [{"position": 2}],
    "front_right": [{"position": 3}],
    "rear_right": [{"position": 4}],
}


def found(**sections) -> dict[str, str]:
    given = findings(Config.model_validate(sections))
    return {dotted(finding.place): finding.words for finding in given if not finding.is_warning}


def warned(**sections) -> dict[str, str]:
    given = findings(Config.model_validate(sections))
    return {dotted(finding.place): finding.words for finding in given if finding.is_warning}


def test_the_defaults_agree_with_each_other():
    assert findings(Config()) == []


def test_every_rule_says_what_it_is_about():
    assert all((rule.__doc__ or "")[:1].isupper() for rule in RULES)


@pytest.mark.parametrize("preset", ["2wd", "4wd"])
def test_presets_need_nothing_else(preset):
    assert findings(Config.model_validate({"chassis": {"preset": preset}})) == []


def test_a_preset_contradicts_other_kinematics_wheels_and_positions():
    chassis = {"preset": "4wd", "kinematics": "mecanum", "motors": MECANUM}
    lines = found(chassis=chassis)
    assert lines.keys() == {"chassis.kinematics", *(f"chassis.motors.{wheel}" for wheel in MECANUM)}
    assert lines["chassis.kinematics"].endswith("which is skid_steer; leave out one")
    lines = found(chassis={"preset": "2wd", "motors": {"left": [{"position": 2}]}})
    (words,) = lines.values()
    assert "has M1 there" in words
    assert 'replace preset by kinematics = "differential" and name all motors' in words
    twice = [{"position": 4, "encoder_sign": -1}, {"position": 4, "command_sign": -1}]
    lines = found(chassis={"preset": "4wd", "motors": {"right": twice}})
    assert lines == {"chassis.motors.right[1].position": "position 4 is named twice"}


def test_a_preset_may_stand_beside_its_own_motors():
    chassis = {"preset": "mecanum", "motors": MECANUM, "wheel_base_m": 0.2}
    assert found(chassis=chassis) == {}


def test_a_wheel_that_the_base_has_not_is_named_with_those_that_it_has():
    motors = {"leftt": [{"position": 1}], "right": [{"position": 3}]}
    lines = found(chassis={"motors": motors})
    assert lines["chassis.motors.leftt"].endswith("a differential base has the wheels left, right")
    assert lines["chassis.motors.left"].startswith("missing")


def test_mecanum_needs_four_wheels_and_their_base():
    motors = {"left": [{"position": 1}], "right": [{"position": 2}]}
    lines = found(chassis={"kinematics": "mecanum", "motors": motors})
    assert {
        "chassis.motors.front_left",
        "chassis.motors.rear_left",
        "chassis.motors.front_right",
        "chassis.motors.rear_right",
        "chassis.wheel_base_m",
    } <= set(lines)


def test_a_geometry_without_motors_is_one_mistake_that_names_the_preset():
    lines = found(chassis={"kinematics": "mecanum", "wheel_base_m": 0.2})
    assert set(lines) == {"chassis.motors"}
    assert 'set chassis.preset = "mecanum"' in lines["chassis.motors"]


def test_mecanum_keys_do_not_belong_on_two_sides():
    lines = found(chassis={"wheel_base_m": 0.2, "wheel_radius_multiplier": {"front_left": 1.1}})
    assert set(lines) == {
        "chassis.wheel_base_m",
        "chassis.wheel_radius_multiplier.front_left",
    }


def test_only_skid_steer_has_several_motors_on_a_side():
    motors = {"left": [{"position": 1}, {"position": 2}], "right": [{"position": 3}]}
    assert "skid_steer" in found(chassis={"motors": motors})["chassis.motors.left"]
    assert found(chassis={"motors": motors, "kinematics": "skid_steer"}) == {}


def test_two_motors_cannot_share_a_place_or_a_name():
    motors = {
        "left": [{"position": 1, "name": "a"}, {"position": 1, "name": "b"}],
        "right": [{"position": 3, "name": "a"}],
    }
    lines = found(chassis={"kinematics": "skid_steer", "motors": motors})
    assert set(lines) == {"chassis.motors.left[1].position", "chassis.motors.right[0].name"}
    assert "chassis.motors.left[0]" in lines["chassis.motors.left[1].position"]


def test_a_joint_is_that_of_a_motor():
    assert set(found(ros2={"joint_names": {"lefd": "x"}})) == {"ros2.joint_names.lefd"}


def test_motors_without_encoder_are_refused_with_the_reason():
    board = {
        "profile": "custom",
        "lines": 13,
        "ratio": 45,
        "wheel_diameter_mm": 68,
        "motor_type": 4,
    }
    assert "no odometry" in found(board=board)["board.motor_type"]


def test_a_custom_profile_names_what_it_lacks():
    assert set(found(board={"profile": "custom"})) == {"board.ratio", "board.wheel_diameter_mm"}
    chassis = {"ticks_per_revolution": 1320, "wheel_radius_m": 0.03}
    assert found(board={"profile": "custom"}, chassis=chassis) == {}


def test_a_custom_profile_turns_its_motor_once_per_turn_at_least():
    chassis = {"ticks_per_revolution": 20, "wheel_radius_m": 0.03}
    lines = found(board={"profile": "custom"}, chassis=chassis)
    assert lines["chassis.ticks_per_revolution"].startswith("expected at least 44")


def test_figures_of_a_custom_profile_contradict_a_named_one():
    lines = found(board={"profile": "310", "ratio": 20, "lines": 13})
    assert set(lines) == {"board.ratio", "board.lines"}


def test_a_timeout_lasts_two_control_periods():
    lines = found(command={"timeout_s": 0.3, "rate_hz": 5, "sources": {"joy": {"timeout_s": 0.39}}})
    assert set(lines) == {"command.timeout_s", "command.sources.joy.timeout_s"}
    assert found(command={"timeout_s": 0.4, "rate_hz": 5, "sources": {"joy": {}}}) == {}


def test_a_speed_is_repeated_before_the_shortest_timeout():
    assert "cmd_vel/teleop" in found(command={"resend_s": 0.3})["command.resend_s"]
    assert found(command={"resend_s": 0.29}) == {}


def test_200_polls_a_second_fit_the_line_and_210_do_not():
    serial = {"dialect": "polled"}
    assert found(serial=serial, odometry={"poll_rate_hz": 200}) == {}
    lines = found(serial=serial, odometry={"poll_rate_hz": 210})
    assert lines["odometry.poll_rate_hz"].startswith("expected at most 202")
    assert "odometry.poll_rate_hz" in found(
        serial={"dialect": "polled", "baudrate": 9600}, odometry={"publish_rate_hz": 10}
    )


def test_5_polls_a_second_show_wheels_that_turn_and_4_do_not():
    rates = {"publish_rate_hz": 1}
    for dialect, look in (("polled", found), ("auto", warned)):
        lines = look(serial={"dialect": dialect}, odometry={"poll_rate_hz": 4, **rates})
        assert set(lines) == {"odometry.poll_rate_hz"}
        assert look(serial={"dialect": dialect}, odometry={"poll_rate_hz": 5, **rates}) == {}
    assert found(serial={"dialect": "streamed"}, odometry={"poll_rate_hz": 1, **rates}) == {}


def test_too_many_polls_are_a_warning_while_the_dialect_is_open():
    assert set(warned(odometry={"poll_rate_hz": 210})) == {"odometry.poll_rate_hz"}
    assert warned(serial={"dialect": "streamed"}, odometry={"poll_rate_hz": 210}) == {}


def test_no_more_samples_are_published_than_taken():
    assert set(found(odometry={"publish_rate_hz": 60})) == {"odometry.publish_rate_hz"}
    streamed = {"dialect": "streamed"}
    assert found(serial=streamed, odometry={"publish_rate_hz": 100}) == {}
    assert set(found(serial=streamed, odometry={"publish_rate_hz": 101})) == {
        "odometry.publish_rate_hz"
    }


def test_a_client_needs_a_router_and_does_not_listen():
    assert found(zenoh={"mode": "client"}) == {}
    assert set(found(zenoh={"mode": "client", "connect": [], "listen": ["tcp/[::1]:1"]})) == {
        "zenoh.connect",
        "zenoh.listen",
    }


def test_a_client_names_its_router_beside_a_zenoh_file_too(tmp_path):
    # The bus refuses endpoints in that file.
    file = tmp_path / "zenoh.json5"
    file.write_text("{}")
    zenoh = {"mode": "client", "connect": [], "config": str(file)}
    assert set(found(zenoh=zenoh)) == {"zenoh.connect"}


def test_a_bus_that_no_client_can_reach_is_refused():
    assert set(found(zenoh={"connect": [], "listen": []})) == {"zenoh.listen"}


def test_an_endpoint_is_listened_on_or_joined():
    both = ["tcp/127.0.0.1:7447"]
    assert set(found(zenoh={"listen": both})) == {"zenoh.connect"}


def test_a_zenoh_file_must_exist(tmp_path):
    missing = str(tmp_path / "zenoh.json5")
    assert set(found(zenoh={"config": missing})) == {"zenoh.config"}
    (tmp_path / "zenoh.json5").write_text("{}")
    assert found(zenoh={"config": missing}) == {}


@pytest.mark.parametrize(
    ("endpoint", "is_open"),
    [
        ("tcp/0.0.0.0:7448", True),
        ("tcp/[::]:7448", True),
        ("tcp/192.168.1.5:7448", True),
        ("tcp/127.0.0.2:7448", False),
        ("tcp/[::1]:7448", False),
        ("tcp/localhost:7448", False),
        ("unixsock-stream//run/z.sock", False),
    ],
)
def test_listening_beyond_this_machine_is_a_warning(endpoint, is_open):
    assert bool(warned(zenoh={"listen": [endpoint]})) is is_open


def test_frames_topics_and_sources_have_names_of_their_own():
    lines = found(
        odometry={"frame_id": "base_link"},
        ros2={"odom_topic": "tf", "diagnostics_topic": "battery_state"},
        command={"sources": {"joint_states": {}}},
    )
    assert set(lines) == {
        "odometry.child_frame_id",
        "ros2.odom_topic",
        "ros2.diagnostics_topic",
        "command.sources.joint_states",
    }


@pytest.mark.parametrize("topic", ["tf", "tf_static", "estopped", "rosout"])
def test_a_topic_whose_name_is_fixed_is_not_taken_by_another(topic):
    assert set(found(ros2={"odom_topic": topic})) == {"ros2.odom_topic"}
    assert set(found(command={"sources": {topic: {}}})) == {f"command.sources.{topic}"}


def test_no_topic_of_ros_has_the_key_of_a_native_sample():
    # Two encodings on one key would be garbage to the readers of both.
    lines = found(ros2={"joint_states_topic": "yahboomd/wheels", "odom_topic": "wheels/odom"})
    assert set(lines) == {"ros2.joint_states_topic"}


def test_a_source_may_be_called_as_a_topic_without_the_bridge():
    ros2 = {"bridge": False}
    assert found(ros2=ros2, command={"sources": {"joint_states": {}}}) == {}


def test_more_than_the_board_can_do_and_a_stall_that_is_never_seen_are_warnings():
    assert set(warned(limits={"linear": {"velocity": 1.1}})) == {"limits.linear.velocity"}
    assert "than the board takes (1 m/s)" in str(warned(limits={"linear": {"velocity": 1.1}}))
    assert set(warned(limits={"linear": {"velocity": 0.05}})) == {"faults.min_speed_m_s"}


def test_a_ramp_that_lasts_long_after_silence_is_warned_of():
    slow = {"linear": {"velocity": 1.0, "deceleration": 0.2}, "angular": {"deceleration": 1.0}}
    lines = warned(limits=slow)
    assert set(lines) == {"limits.linear.deceleration", "limits.angular.deceleration"}
    assert "takes 5.0 s and 2.5 m to stand" in lines["limits.linear.deceleration"]
    assert warned(limits=slow, command={"on_timeout": "halt"}) == {}
    assert warned(limits={"linear": {"velocity": 1.0, "deceleration": 0.5}}) == {}


def test_the_odometry_believes_the_speeds_that_are_allowed():
    lines = found(limits={"linear": {"velocity": 3.0}})
    words = lines["odometry.max_wheel_speed_m_s"]
    assert words.endswith(
        "got 2; raise it too: --set odometry.max_wheel_speed_m_s=4, or lower the velocity"
    )
    lines = found(odometry={"max_wheel_speed_m_s": 1.0})
    assert set(lines) == {"odometry.max_wheel_speed_m_s"}
    assert found(odometry={"max_wheel_speed_m_s": 1.1}) == {}


def test_no_source_that_may_drive_is_a_warning():
    assert set(warned(command={"sources": {}})) == {"command.sources"}


def test_a_namespace_is_a_name_of_ros_where_it_goes_into_a_graph():
    zenoh = {"namespace": "my-bot"}
    assert found(zenoh=zenoh) == {}
    assert set(found(zenoh=zenoh, ros2={"rmw_zenoh": True})) == {"zenoh.namespace"}


def test_only_sources_can_be_stamped():
    assert found(ros2={"stamped_commands": ["cmd_vel"]}) == {}
    lines = found(ros2={"stamped_commands": ["cmd_vel", "nav"]})
    assert set(lines) == {"ros2.stamped_commands[1]"}
    assert "cmd_vel" in lines["ros2.stamped_commands[1]"]


def test_a_frame_has_one_parent():
    transforms = [
        {"parent": "base_link", "child": "laser"},
        {"parent": "base_link", "child": "laser"},
        {"parent": "map", "child": "base_link"},
        {"parent": "imu", "child": "imu"},
    ]
    lines = found(ros2={"static_transforms": transforms})
    assert set(lines) == {f"ros2.static_transforms[{index}].child" for index in (1, 2, 3)}
    assert "static_transforms[0]" in lines["ros2.static_transforms[1].child"]
    assert "odometry.child_frame_id" in lines["ros2.static_transforms[2].child"]


def test_a_motor_of_a_wheel_that_the_preset_lists_under_its_side_is_named_with_its_place():
    lines = found(chassis={"preset": "4wd", "motors": {"front_left": [{"position": 1}]}})
    assert lines["chassis.motors.front_left"] == (
        'preset "4wd" has the wheels left, right: write motors.left = [{ position = 1, \u2026 }]'
    )


def test_one_side_alone_without_a_preset_names_the_preset_that_keeps_the_other():
    lines = found(chassis={"motors": {"left": [{"position": 1, "command_sign": -1}]}})
    assert 'set chassis.preset = "2wd" and name only' in lines["chassis.motors.right"]


def test_a_car_that_steers_needs_its_axles_and_no_other_base_has_a_steering():
    lines = found(chassis={"preset": "ackermann"})
    assert "ackermann needs the distance" in lines["chassis.wheel_base_m"]
    assert found(chassis={"preset": "ackermann", "wheel_base_m": 0.235}) == {}
    car = {"kinematics": "ackermann", "wheel_base_m": 0.235, "steering_max_rad": 0.6}
    assert found(chassis=car) == {}
    lines = found(chassis={"steering_max_rad": 0.6})
    assert "belongs to an ackermann base" in lines["chassis.steering_max_rad"]


def test_the_way_to_the_side_belongs_to_mecanum_wheels() -> None:
    lines = found(chassis={"sideways_multiplier": 0.9})
    assert "belongs to a mecanum base" in lines["chassis.sideways_multiplier"]
    mecanum = {"preset": "mecanum", "wheel_base_m": 0.2, "sideways_multiplier": 0.9}
    assert found(chassis=mecanum) == {}


def test_a_battery_is_low_before_it_is_empty_and_its_voltage_is_asked_for():
    curve = [[9.6, 0.0], [10.5, 0.1], [12.6, 1.0]]
    assert found(board={"battery_curve": curve, "battery_stop_v": 9.6}) == {}
    lines = found(board={"battery_curve": curve, "battery_stop_v": 10.5})
    assert lines == {"board.battery_stop_v": "expected less than battery_low_v (10.5), got 10.5"}
    assert found(board={"battery_stop_v": 10.5}) == {}
    lines = warned(board={"battery_low_v": 10.5, "battery_period_s": 0.0})
    assert lines.keys() == {"board.battery_low_v"}
