"""A golden sample of each message of `yahboomd moves`."""

from __future__ import annotations

import msgspec

from make.schema_files.samples import STAMP_NS
from yahboomd.client.move_messages import Move, MoveBeat, MoveChoice, MoveRequest, MoveSample

ID = "5f1c09ab"

SAMPLES: dict[str, msgspec.Struct] = {
    type(message).__name__: message
    for message in (
        MoveRequest(
            moves=(
                Move(kind="straight", distance_m=1.0, speed_m_s=0.25),
                Move(kind="turn", angle_rad=-1.5),
                Move(kind="go_to", x=2.0, y=-1.5, theta=0.5, backward=True),
                Move(kind="follow", points=((2.5, -1.5), (3.0, -1.0, 0.75))),
            ),
            by="my_app",
            holder="my_app_17",
        ),
        MoveBeat(id=ID),
        MoveChoice(id=ID),
        MoveSample(
            stamp_ns=STAMP_NS,
            id=ID,
            state="ended",
            kind="turn",
            index=1,
            count=4,
            done=0.375,
            left_m=4.5,
            left_rad=2.25,
            left_s=17.5,
            reason="taken_over",
            message="cmd_vel/teleop has taken over.",
            by="my_app",
        ),
    )
}
