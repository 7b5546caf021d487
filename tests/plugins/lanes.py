"""Which process runs which test, where several processes run them side by side.

Tests that are marked ``realtime`` wait for most of their time, and want a processor when they
wake; the others use all that they get. So one process of two or three computes, at a low priority,
and waits when nothing is left to compute; the others wait. What floods or measures is late beside
its like: the first process has it all, one after the other. With a process for each core it has no
robots beside it; processes more than the cores begin once nothing floods, and the last one
computes. The tests of an ``xdist_group`` have one process.
"""

from __future__ import annotations

import functools
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from xdist.scheduler import LoadScopeScheduling

if TYPE_CHECKING:
    from xdist.workermanage import WorkerController

HEAVY = (
    "tests/soak",
    "tests/benchmarks",
    "tests/faults/test_estop_flood",
    "tests/faults/test_flood",
    "tests/security/test_access.py::test_a_viewer_who_floods",
)
"""They are long, and keep the machine busy: one after the other, from the start."""

LONG = (
    "tests/whole/test_page",
    "tests/tools/calibrate",
    "tests/tools/tune",
    "tests/tools/setup",
    "tests/test_end_to_end",
    "tests/faults/test_link_real",
)
"""They come early: all processes wait for a long test that begins last."""

_GROUP = re.compile(r'xdist_group\("(\w+)"\)')
_ALL_REAL = re.compile(r"^(pytestmark = \[?|    )pytest\.mark\.realtime\b", re.MULTILINE)
_ONE_REAL = re.compile(
    r"^@pytest\.mark\.realtime\n(?:[@ )\]].*\n)*(?:async )?def (\w+)", re.MULTILINE
)


@functools.cache
def _marks(path: Path) -> tuple[str | None, bool, frozenset[str]]:
    """The group of a file, whether all its tests are in real time, and which of them are."""
    text = path.read_text()
    group = _GROUP.search(text)
    return group and group[1], bool(_ALL_REAL.search(text)), frozenset(_ONE_REAL.findall(text))


def computes(number: int) -> bool:
    """Whether a process computes first: one of two or three, and the last one."""
    return number % 3 == 1 or number > max(2, os.cpu_count() or 1)


def begins_late(number: int) -> bool:
    """Whether a process is one more than the cores: it begins once nothing floods."""
    return number >= max(2, os.cpu_count() or 1)


class Lanes(LoadScopeScheduling):  # type: ignore[misc]
    """Each process has a test, or a group of them, and the next one."""

    def schedule(self) -> None:
        """Begin, once all processes have found the same tests."""
        if self.collection is not None or not self._check_nodes_have_same_collection():
            return
        self.collection = next(iter(self.registered_collections.values()))
        self._index = {nodeid: index for index, nodeid in enumerate(self.collection)}
        self._waits: set[str] = set()
        self._heavy: set[str] = set()
        for nodeid in self.collection:
            scope = self._split_scope(nodeid)
            self.workqueue.setdefault(scope, {})[nodeid] = False
            if self._in_real_time(nodeid):
                self._waits.add(scope)
                if nodeid.startswith(HEAVY):
                    self._heavy.add(scope)
        order = sorted(self.workqueue, key=self._rank)
        self.workqueue = type(self.workqueue)((scope, self.workqueue[scope]) for scope in order)
        for _ in range(2):
            for node in self.nodes:
                self._reschedule(node)

    def mark_test_complete(
        self, node: WorkerController, item_index: int, duration: float = 0
    ) -> None:
        """Note it, and give its process the next one."""
        nodeid = self.collection[item_index]
        scope = self._split_scope(nodeid)
        unit = self.assigned_work[node][scope]
        unit[nodeid] = True
        if all(unit.values()):
            del self.assigned_work[node][scope]
        for each in self.nodes:
            self._reschedule(each)

    def _reschedule(self, node: WorkerController) -> None:
        if node.shutting_down or self._pending_of(self.assigned_work[node]) > 1:
            return
        number = int(node.gateway.id.removeprefix("gw"))
        if begins_late(number) and self._floods():
            return
        scope = self._next_scope(number)
        if scope is None:
            node.shutdown()
            return
        self.assigned_work[node][scope] = unit = self.workqueue.pop(scope)
        node.send_runtest_some([self._index[each] for each, done in unit.items() if not done])

    def _floods(self) -> bool:
        """Whether something heavy runs, or is still to come."""
        to_come = self.workqueue and next(iter(self.workqueue)) in self._heavy
        return bool(to_come) or any(
            not self._heavy.isdisjoint(units) for units in self.assigned_work.values()
        )

    def _next_scope(self, number: int) -> str | None:
        """The next scope for a process: the first takes them in order, computations come last."""
        if computes(number):
            return next(reversed(self.workqueue), None)
        return next(
            (each for each in self.workqueue if not number or each not in self._heavy), None
        )

    def _split_scope(self, nodeid: str) -> str:
        return _marks(self._path(nodeid))[0] or nodeid

    def _path(self, nodeid: str) -> Path:
        path: Path = self.config.rootpath / nodeid.partition("::")[0]
        return path

    def _in_real_time(self, nodeid: str) -> bool:
        _, all_real, some = _marks(self._path(nodeid))
        return all_real or nodeid.partition("::")[2].partition("[")[0] in some

    def _rank(self, scope: str) -> tuple[bool, bool, bool, bool]:
        """Real time first, and in it heavy tests, groups and long tests."""
        return (
            scope not in self._waits,
            scope not in self._heavy,
            "::" in scope,
            not scope.startswith(LONG),
        )
