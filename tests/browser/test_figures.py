"""Sizes and times of the page; `make browser ARGS='-k figures -rP'` prints those of docs/web.md."""

from __future__ import annotations

import json
import statistics
import time
from bisect import bisect
from collections.abc import Sequence
from itertools import pairwise

import pytest
from chromium import Page
from page_bench import PageBench
from real_robot import wait_for

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]

TOUCHES = 200
OVER_NS = 2_000_000_000

NOTE_POSE = """
window.WebSocket = class extends WebSocket {
  constructor(...address) {
    super(...address);
    this.addEventListener("message", ({ data }) => {
      if (data.includes('"type":"pose"')) window.firstPose ??= performance.now();
    });
  }
};
"""

FRAMES = """(async () => {
  const [{ map }, { Live }] = await Promise.all([import("/page/map.js"), import("/page/live.js")]);
  const live = new Live();
  const view = map.create({ live, connection: {}, onStop: new Set() });
  document.querySelector("#main").prepend(view.element);
  view.element.style.height = "100%";
  const pose = (n) => live.emit("pose", { sample: {
    x: n / 400 + Math.cos(n / 40), y: Math.sin(n / 30) + Math.sin(n / 977), theta: n / 50,
    covariance: [0.01, 0, 0, 0, 0.02, 0, 0, 0, 0.01] } });
  let n = 0;
  while (n < 9_900) pose(n++);
  const frame = () => new Promise(requestAnimationFrame);
  await frame();
  view.element.querySelector(".tools button[title^='Show all']").click();
  const began = performance.now();
  let frames = 0;
  while (performance.now() - began < 4000) {
    pose(n++ % 9_900);
    await frame();
    frames += 1;
  }
  view.element.remove();
  return (frames * 1000) / (performance.now() - began);
})()"""
"""Frames a second of a map of its own that is full, with all of it shown and a pose each frame."""


def shares(milliseconds: Sequence[float]) -> str:
    cuts = statistics.quantiles(milliseconds, n=100)
    return f"median {cuts[49]:.1f} ms, p99 {cuts[98]:.1f} ms, worst {max(milliseconds):.1f} ms"


def test_the_first_load_is_below_150_kb(page: Page) -> None:
    entries = json.loads(
        page.evaluate(
            "JSON.stringify([...performance.getEntriesByType('navigation'),"
            " ...performance.getEntriesByType('resource')]"
            ".map((e) => [e.name, e.transferSize, e.decodedBodySize]))"
        )
    )
    loaded = {name: sizes for name, *sizes in entries if "/page/" in name or name.endswith("/")}
    transferred, whole = (sum(sizes[at] for sizes in loaded.values()) for at in (0, 1))
    print(f"first load: {transferred} bytes in {len(loaded)} files, {whole} unpacked")
    assert len(loaded) > 10
    assert whole < 150_000


@pytest.mark.nightly
def test_figures_of_the_time_from_load_to_a_live_pose(bench: PageBench, page: Page) -> None:
    page.order("Page.addScriptToEvaluateOnNewDocument", source=NOTE_POSE)
    page.order("Network.setCacheDisabled", cacheDisabled=True)
    times = []
    for _ in range(20):
        page.go("about:blank#")
        page.order("Page.navigate", url=bench.url)
        times.append(page.until("window.firstPose"))
    print(f"from load to a live pose: {shares(times)}")


@pytest.mark.nightly
@pytest.mark.parametrize("size", [(360, 740), (1920, 1080)], ids=["phone", "desktop"])
def test_figures_of_the_map_with_10000_points(page: Page, size: tuple[int, int]) -> None:
    page.resize(*size, phone=size[0] < 1000)
    page.evaluate("location.hash = '#map'")
    print(f"frames a second at {size[0]} x {size[1]}: {page.evaluate(FRAMES):.1f}")


def touch_once(bench: PageBench, page: Page, finger: tuple[float, float]) -> int:
    """Move a thumb until the robot moves; the moment before. No file is read meanwhile."""

    def moves() -> bool:
        return abs(bench.application.latest("twist")["vx"]) > 0.01

    page.touch(page.middle(".pad"))
    before_ns = time.monotonic_ns()
    page.touch(finger, kind="touchMove")
    # A machine that was too busy refuses one: then it stands.
    over_ns = time.monotonic_ns() + OVER_NS
    wait_for(lambda: moves() or time.monotonic_ns() > over_ns, "the robot moves")
    page.lift()
    wait_for(lambda: not moves(), "the robot stands")
    return before_ns


@pytest.mark.nightly
def test_figures_of_the_time_from_finger_to_wheel_frame(bench: PageBench) -> None:
    with bench.page(bench.direct_url) as page:
        bench.press(page)
        page.lift()
        bench.robot.settled_truth()
        finger = bench.place(page, 0.0, 0.6)
        touched = [touch_once(bench, page, finger) for _ in range(TOUCHES)]
    moved = list(bench.motions(touched[0]))
    times = [
        (moved[first] - before_ns) / 1e6
        for before_ns, after_ns in pairwise([*touched, time.monotonic_ns()])
        if (first := bisect(moved, before_ns)) < len(moved) and moved[first] < after_ns
    ]
    print(f"from finger to wheel frame: {shares(times)}, {len(times)} of {TOUCHES} touches")
    assert len(times) > TOUCHES / 2
