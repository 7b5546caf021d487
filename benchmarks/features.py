"""Features of the article's bridge and of yahboomd.

The bridge's cells describe ``benchmarks/article.py``, which is rebuilt from the article;
``docs`` explains yahboomd's. The rebuilt bridge has no ROS messages, so their optional contents are
marked with -.
"""

from __future__ import annotations

FEATURES = [
    [
        "needs ROS 2",
        "yes: it is a node",
        "no; appears in ROS 2 through zenoh-bridge-ros2dds, or natively with rmw_zenoh",
    ],
    ["dialects of the board", "polled", "polled, streamed and rosmaster, detected"],
    [
        "who may command",
        "one topic; the last velocity counts",
        "several keys with priorities; downward only from standstill",
    ],
    [
        "age of a command",
        "not checked",
        "refused when older than its timeout, by its stamp or Zenoh's; a backlog too",
    ],
    [
        "commands end",
        "drives on",
        "ramp or halt after 0.5 s, teleop 0.3 s, each source its own",
    ],
    ["emergency stop", "none", "latched; survives restarts and kills of the daemon"],
    [
        "at its end",
        "sends one speed of zero",
        "repeats a stop until the counters show that the wheels stand, then closes the port",
    ],
    [
        "after kill -9",
        "the wheels turn on",
        "stop as soon as the service manager has run `yahboomd stop --direct`, some 0.1 s later",
    ],
    [
        "unplugged",
        "the wheels turn on; the port is never opened again",
        "the wheels turn on too; stopped first once the plug is back, then drives",
    ],
    [
        "reset of the board",
        "sets the motor type at its start alone, so the wheels stand until its restart",
        "sets it again, stands 1 s, drives on",
    ],
    [
        "counters at the start, or after a reset",
        "the difference to 0, or to the last counts, is travel",
        "a new baseline; after a reset an event says what is unknown",
    ],
    [
        "garbled counters",
        "travel, if the frame can be parsed",
        "held until later readings agree; counted",
    ],
    [
        "wheels that lie: dead encoder, runaway, stalled, wrong plug",
        "not checked",
        "stopped, named by wheel; a streamed board's motors are cut",
    ],
    [
        "limits and ramps",
        "1000 units a wheel",
        "speed, acceleration, deceleration and jerk, forward and turning",
    ],
    [
        "saturation keeps the curve",
        "no: each wheel is clipped by itself",
        "yes: all wheels are scaled alike",
    ],
    ["kinematics", "differential", "differential, skid steer, mecanum, ackermann"],
    [
        "odometry",
        "midpoint; the heading is a sum of steps",
        "arc with a correction for changing curvature; the heading from whole counts",
    ],
    [
        "stamp of a pose",
        "when the read ended, some 50 ms after the answer",
        "when the board took its counts; polled: when its answer left",
    ],
    ["covariance", "-", "of pose and twist, propagated step by step"],
    ["battery", "not read (the polled dialect has no answer)", "volts, of a streamed board"],
    [
        "status",
        "prints what failed",
        "state and the reason for it, counters, events; ROS diagnostics",
    ],
    ["encodings", "ROS messages", "JSON, MessagePack, CDR, with schemas"],
    ["service", "none", "systemd units, udev rule, Debian package"],
    ["watchdog", "none", "systemd's, 2 s, fed by control steps alone"],
    [
        "simulator",
        "none",
        "both dialects, all three geometries, faults on command, ground truth",
    ],
]
"""Rows: feature, the article's bridge, yahboomd."""
