"""Every target over its corpus, and over seeded variations of it.

``make fuzz`` tries millions, following the code's branches; its finds join the corpus.
"""

from __future__ import annotations

import re
from pathlib import Path
from random import Random

import pytest
from fuzz_targets import TARGETS

CORPUS = Path(__file__).parent / "corpus"
TRIES = {"config": 60, "override": 120}
MOST_TRIES = 1500

PIECES = re.compile(rb"[A-Za-z_]+|-?[0-9.]+|.", re.DOTALL)
ODDITIES = [
    *(b"", b"\x00", b"\xff", b"\n", b"$", b"#", b"{", b"}", b"[", b'"', b"=", b".", b",", b"-"),
    *(b"nan", b"inf", b"1e999", b"-0", b"4294967296", b"-2147483649", b"null", b"false", b"true"),
    *(b"\xc0", b"\xcb\x7f\xf8\x00\x00\x00\x00\x00\x00", b"\xdf\xff\xff\xff\xff", b"\xef\xbb\xbf"),
]


def corpus(target: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((CORPUS / target).iterdir())]


def changed(data: bytes, seeds: list[bytes], chance: Random) -> bytes:
    """An input much like one of the corpus."""
    for _ in range(chance.choice([1, 1, 2, 4])):
        at = chance.randrange(len(data) + 1)
        match chance.randrange(6):
            case 0:
                data = data[:at] + bytes([chance.randrange(256)]) + data[at + 1 :]
            case 1:
                data = data[:at] + chance.choice(ODDITIES) + data[at:]
            case 2:
                data = data[:at] + data[min(len(data), at + chance.randrange(9)) :]
            case 3:
                other = chance.choice(seeds)
                data = data[:at] + other[chance.randrange(len(other) + 1) :]
            case 4:
                pieces = PIECES.findall(data) or [b""]
                pieces[chance.randrange(len(pieces))] = chance.choice(ODDITIES)
                data = b"".join(pieces)
            case _:
                data = data[:at] + data[at : at + 8] * chance.choice([2, 40]) + data[at:]
    return data[:8192]


@pytest.mark.parametrize("target", TARGETS)
def test_every_input_of_the_corpus_keeps_the_laws(target: str) -> None:
    seeds = corpus(target)
    assert len(seeds) >= 5
    for data in seeds:
        TARGETS[target](data)


@pytest.mark.parametrize("target", TARGETS)
def test_what_is_made_of_the_corpus_keeps_the_laws(target: str) -> None:
    seeds = corpus(target)
    chance = Random(f"{target} 1")
    tries = TRIES.get(target, MOST_TRIES)
    for _ in range(tries):
        data = changed(chance.choice(seeds), seeds, chance)
        try:
            TARGETS[target](data)
        except Exception as error:
            error.add_note(f"the input: {data!r}")
            raise
    print(f"{target}: {tries} inputs made of {len(seeds)}")


def test_every_target_has_a_corpus_and_every_corpus_a_target() -> None:
    assert {path.name for path in CORPUS.iterdir()} == set(TARGETS)
