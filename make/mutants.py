"""Checks whether tests notice one-token changes: `make mutants ROOM=drive SAMPLE=120 SEED=1`.

cosmic-ray makes the changes: comparisons, signs, and/or, min/max, numbers. A sample has as large a
part of each file. Each change is imported in a forked process, from memory, so that no file
changes. There the tests of the changed file run first, then the room's others, the quickest of each
first, up to the first failure; tests in real time are left out. If no test notices a change, it
survives: a claim is missing, or the code is not needed. tests/equivalent_mutants.txt lists changes
that cannot be noticed, each with its reason; they count as equivalent.
"""

import argparse
import ast
import contextlib
import gc
import io
import json
import os
import random
import re
import resource
import sys
import tempfile
from collections import Counter
from importlib import machinery
from pathlib import Path

import hypothesis
import parso
import pytest
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.boolean_replacer import ReplaceTrueWithFalse as Guard
from cosmic_ray.operators.operator import Operator
from cosmic_ray.operators.provider import OperatorProvider

HERE = Path(__file__).resolve().parent.parent
EQUIVALENT = HERE / "tests" / "equivalent_mutants.txt"
ROOMS = {
    "protocol": ("yahboomd/core/protocol", ["tests/protocol"]),
    "drive": ("yahboomd/core/drive", ["tests/drive"]),
    "odometry": ("yahboomd/core/odometry", ["tests/odometry"]),
    "calibration": ("yahboomd/tools/calibrate/estimates", ["tests/calibration"]),
    "tuning": ("yahboomd/tools/tune/estimates", ["tests/tuning"]),
    "messages": ("yahboomd/core/messages", ["tests/messages"]),
    "ros2": ("yahboomd/ros2/messages", ["tests/ros2/messages", "tests/ros2/test_ros2_samples.py"]),
    "counts": ("yahboomd/core/counts.py", ["tests/test_counts.py"]),
    "model": ("yahboomd/core/model.py", ["tests/test_model.py"]),
    "names": ("yahboomd/core/names.py", ["tests/test_names.py"]),
}
NEIGHBOURS = {
    "Binary": "Add_Sub Sub_Add Mul_Div Div_Mul FloorDiv_Mul Mod_Mul",
    "Comparison": "Lt_LtE Lt_Gt LtE_Lt LtE_Gt Gt_GtE Gt_Lt GtE_Gt GtE_Lt Eq_NotEq NotEq_Eq "
    "Is_IsNot IsNot_Is",
}
PLAIN = (
    "AddNot ReplaceAndWithOr ReplaceOrWithAnd ReplaceTrueWithFalse ReplaceFalseWithTrue "
    "ReplaceBreakWithContinue ReplaceContinueWithBreak ZeroIterationForLoop "
    "ReplaceUnaryOperator_Delete_USub ReplaceUnaryOperator_Delete_Not"
)
DECLARES = re.compile(r"^\s*class |TYPE_CHECKING|(^|[(,])\s*\*,")


class Token(Operator):
    """Replaces one token by another."""

    def other(self, value):
        """The replacement of a token; None for a token that stays."""
        raise NotImplementedError

    def mutation_positions(self, node):
        """The places of a change."""
        if isinstance(node, self.kind) and self.other(node.value) is not None:
            yield node.start_pos, node.end_pos

    def mutate(self, node, _index):
        """Replace it."""
        return self.kind(self.other(node.value), node.start_pos, node.prefix)

    @classmethod
    def examples(cls):
        """Return none."""
        return ()


class MinMax(Token):
    """Replaces min and max by each other."""

    kind = parso.python.tree.Name

    def other(self, value):
        """See the base class."""
        return {"min": "max", "max": "min"}.get(value)


class Number(Token):
    """Adds one to a number, or doubles it if one more would hardly show."""

    kind = parso.python.tree.Number

    def other(self, value):
        """See the base class."""
        number = ast.literal_eval(value)
        return repr(number + 1 if abs(number) < 1 or number in range(10) else number * 2)


def operators():
    """The operators of every change."""
    provider = OperatorProvider()
    for kind, pairs in NEIGHBOURS.items():
        for pair in pairs.split():
            yield provider[f"Replace{kind}Operator_{pair}"]()
    for name in PLAIN.split():
        yield provider[name]()
    yield from (MinMax(), Number())


def places(path):
    """The possible changes of a file: operator, number of its occurrence, and line.

    Class declarations are left out, and so is `zip(strict=True)`, which guards against mistakes.
    """
    source = path.read_text()
    nodes = list(ast_nodes(get_ast(source)))
    lines = source.splitlines()
    for operator in operators():
        starts = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        for occurrence, (line, _) in enumerate(starts):
            text = lines[line - 1]
            if not (
                DECLARES.search(text) or (isinstance(operator, Guard) and "strict=True" in text)
            ):
                yield path, operator, occurrence, line


def sampled(paths, seed):
    """All places in an order drawn by `seed`: any beginning has its part of every file."""
    chance = random.Random(seed)
    ranked = []
    for path in paths:
        found = list(places(path))
        chance.shuffle(found)
        start = chance.random()
        ranked += [((rank + start) / len(found), place) for rank, place in enumerate(found)]
    return [place for _, place in sorted(ranked, key=lambda each: each[0])]


def change(path, operator, occurrence, line):
    """The changed text, and the line before and after; None if the result is no Python."""
    source = path.read_text()
    changed = mutate_code(source, operator, occurrence)
    try:
        compile(changed, str(path), "exec", dont_inherit=True)
    except SyntaxError:
        return None
    before, after = (text.splitlines()[line - 1].strip() for text in (source, changed))
    return changed, before, after


TOOK = {}
"""The time that each test takes without a change, in seconds."""


class Hurry:
    """Runs slow tests last, and keeps hypothesis from looking for smaller examples."""

    def pytest_configure(self):
        """Load a profile after conftest.py did."""
        settings = hypothesis.settings
        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
        settings.register_profile("mutants", settings.default, phases=phases, database=None)
        settings.load_profile("mutants")

    def pytest_collection_modifyitems(self, items):
        """Sort the tests, the quickest first."""
        items.sort(key=lambda item: TOOK.get(item.nodeid, 0.0))

    def pytest_runtest_logreport(self, report):
        """Add up the time of each test."""
        TOOK[report.nodeid] = TOOK.get(report.nodeid, 0.0) + report.duration


def passes(*arguments):
    """Whether pytest finds no failure, in this process; no test at all is none."""
    quiet = ["-x", "-q", "--no-header", "--tb=no", "--assert=plain"]
    quiet += ["-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:unraisableexception"]
    # Warnings of modules imported before pytest must not fail.
    quiet += ["-o", "filterwarnings=", "-m", "not realtime and not nightly"]
    return pytest.main([*quiet, *arguments], [Hurry()]) in (0, 5)


def passes_unchanged(note, tests):
    """Whether tests pass without a change; writes the time of each to the file `note`."""
    passed = passes(*tests)
    Path(note).write_text(json.dumps(TOOK))
    return passed


def import_libraries(tests):
    """Import all modules from outside this tree once, for every run."""
    with contextlib.redirect_stdout(io.StringIO()):
        passes("--collect-only", *tests)
    for name, module in list(sys.modules.items()):
        origin = Path(getattr(module, "__file__", None) or "/")
        if origin.is_relative_to(HERE) and not origin.is_relative_to(sys.prefix):
            del sys.modules[name]
    gc.collect()
    gc.freeze()


def unnoticed(path, changed, tests):
    """Whether tests pass in this process, which imports `changed` in place of the file."""
    module = ".".join(path.relative_to(HERE).with_suffix("").parts)
    code = compile(changed, str(path), "exec", dont_inherit=True)
    read = machinery.SourceFileLoader.get_code
    machinery.SourceFileLoader.get_code = lambda loader, name: (
        code if name == module else read(loader, name)
    )
    own = HERE / "tests" / path.relative_to(HERE / "yahboomd").with_name(f"test_{path.name}")
    return (not own.exists() or passes(str(own))) and passes(f"--ignore={own}", *tests)


def forked(limit_s, work, *arguments):
    """The CPU seconds of `work` in a process of its own; None if it fails or exceeds the limit.

    The limit is in CPU seconds too, so that a busy machine does not end it.
    """
    pid = os.fork()
    if not pid:
        passed = False
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
            silence = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silence, 1)
            os.dup2(silence, 2)
            passed = work(*arguments)
        finally:
            os._exit(not passed)
    _, status, usage = os.wait4(pid, 0)
    return None if status else usage.ru_utime + usage.ru_stime


def main():
    """Report the survivors and the share that was killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("room", choices=ROOMS)
    parser.add_argument("--sample", type=int, default=120, help="how many; 0 for all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--file", help="only this file of the room, such as arbiter.py")
    options = parser.parse_args()
    os.chdir(HERE)
    sys.path[:0] = [str(HERE), str(HERE / "tests" / "plugins")]
    where, tests = ROOMS[options.room]
    import_libraries(tests)
    with tempfile.NamedTemporaryFile() as note:
        usual_s = forked(600, passes_unchanged, note.name, tests)
        if usual_s is None:
            sys.exit(f"mutants: the tests of {options.room} fail without a change")
        TOOK.update(json.loads(Path(note.name).read_text()))
    limit_s = 20 + round(5 * usual_s)
    equivalent = {
        tuple(part.strip() for part in line.split(" | ")[:3])
        for line in EQUIVALENT.read_text().splitlines()
        if not line.startswith("#")
    }
    paths = sorted((HERE / where).rglob("*.py")) or [HERE / where]
    if options.file:
        paths = [path for path in paths if path.name == options.file]
    every = sampled(paths, options.seed)
    counted = Counter()
    for path, operator, occurrence, line in every:
        if options.sample and counted.total() == options.sample:
            break
        found = change(path, operator, occurrence, line)
        if found is None:
            continue
        changed, before, after = found
        name = str(path.relative_to(HERE))
        if forked(limit_s, unnoticed, path, changed, tests) is None:
            counted["killed"] += 1
        elif (name, before, after) in equivalent:
            counted["equivalent"] += 1
        else:
            counted["survived"] += 1
            print(f"{name}:{line} | {before} | {after}", flush=True)
    judged = counted["killed"] + counted["survived"]
    share = counted["killed"] / judged if judged else 1.0
    print(
        f"{options.room}: {counted.total()} of {len(every)} changes, seed {options.seed}: "
        f"{counted['killed']} killed, {counted['survived']} survived, "
        f"{counted['equivalent']} equivalent: {share:.0%} killed"
    )


if __name__ == "__main__":
    main()
