from __future__ import annotations

from xml.etree import ElementTree

from benchmarks import flame

LINES = """\
x:main;asyncio.base_events:BaseEventLoop._run_once;yahboomd.core.link.writer:Writer._pump 3
x:main;asyncio.base_events:BaseEventLoop._run_once;yahboomd.core.link.writer:Writer._pump;os:write 2
x:main;asyncio.base_events:BaseEventLoop._run_once;selectors:EpollSelector.select 9
x:main;yahboomd.core.config:load 4
"""


def test_waiting_and_what_came_before_the_loop_do_not_count(tmp_path) -> None:
    (tmp_path / "stacks").write_text(LINES)
    stacks = flame.read(tmp_path / "stacks")
    assert sum(stacks.values()) == 5
    assert flame.by_room(stacks) == {"yahboomd.core.link": 5}
    assert flame.by_function(stacks) == {"yahboomd.core.link.writer:Writer._pump": 5}


def test_a_door_is_one_level_and_a_room_of_the_core_two() -> None:
    stacks = {
        ("asyncio.events:run", "yahboomd.blackbox.records:encode"): 3,
        ("asyncio.events:run", "yahboomd.blackbox.ring:Ring.write"): 2,
        ("asyncio.events:run", "yahboomd.core.bus.bus:Bus.key"): 1,
        ("asyncio.events:run",): 4,
    }
    rooms = flame.by_room(stacks)
    assert rooms == {"yahboomd.blackbox": 5, "yahboomd.core.bus": 1, "asyncio": 4}


def test_the_graph_is_svg_and_names_the_functions(tmp_path) -> None:
    (tmp_path / "stacks").write_text(LINES)
    flame.draw(flame.read(tmp_path / "stacks"), tmp_path / "flame.svg", "a < b")
    root = ElementTree.parse(tmp_path / "flame.svg").getroot()
    texts = " ".join(root.itertext())
    assert "a < b" in texts
    assert "Writer._pump" in texts
