"""The golden samples are correct."""

from __future__ import annotations

import msgspec
import pytest

from make.schema_files import cdr_samples, samples
from yahboomd.core.messages import cdr, native
from yahboomd.core.messages.codecs import (
    ReceivedCommand,
    Refusal,
    decode_command,
    decode_set_pose,
    encode,
    is_release_attempt,
)


def test_every_native_message_has_a_sample():
    defined = {
        name
        for name, each in vars(native).items()
        if isinstance(each, type)
        and issubclass(each, msgspec.Struct)
        and each.__module__ == native.__name__
    }
    assert defined - samples.MESSAGES.keys() == {"AngularZ", "LinearXY"}


@pytest.mark.parametrize("name", samples.NATIVE)
def test_both_encodings_of_a_sample_hold_the_same(name):
    message = samples.NATIVE[name]
    kind = type(message)
    assert msgspec.json.decode(encode(message, "json"), type=kind) == message
    assert msgspec.msgpack.decode(encode(message, "msgpack"), type=kind) == message


def test_every_sample_of_a_command_is_taken():
    native = samples.NATIVE
    payloads = [
        encode(native[name], encoding)
        for name in ("VelocityCommand", "RosVelocityCommand")
        for encoding in ("json", "msgpack")
    ]
    payloads += [cdr_samples.CDR[n].payload for n in ("Twist", "Twist_big_endian", "TwistStamped")]
    for payload in payloads:
        got = decode_command(payload)
        assert isinstance(got, ReceivedCommand)
        assert (got.vx, got.vy, got.wz) == (0.5, 0.0, -0.25)
        assert got.stamp_ns in {None, samples.STAMP_NS}


@pytest.mark.parametrize("name", samples.REFUSED)
def test_refused_samples_are_refused_for_their_reason(name):
    sample = samples.REFUSED[name]
    got = decode_command(sample.payload)
    assert isinstance(got, Refusal)
    assert got.reason == sample.reason


def test_every_reason_has_a_sample_but_the_one_that_is_too_large():
    reasons = {sample.reason for sample in samples.REFUSED.values()}
    assert reasons == {
        "no_velocity",
        "not_finite",
        "too_fast",
        "wrong_type",
        "malformed",
        "unknown_encoding",
    }


def test_the_request_samples_are_taken():
    request = samples.NATIVE["SetPoseRequest"]
    assert decode_set_pose(encode(request, "msgpack")) == request
    assert not is_release_attempt(encode(samples.NATIVE["EstopRequest"], "json"))
    assert cdr.decode_bool(cdr_samples.CDR["SetBool_Request"].payload) is True
