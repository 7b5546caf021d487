"""Whether tests notice one-token changes of a room: `make mutants ROOM=drive SAMPLE=120 SEED=1`.

cosmic-ray makes the changes: comparisons, signs, and/or, min/max, numbers. Each one is imported in
a forked process, from memory, so that no file changes. There the tests of the changed file run
first, then the room's others, up to the first failure; those with real time are left out. A change
that no test notices survives: a claim is missing, or code that is not needed. Changes that cannot
be noticed are listed, each with its reason, in
tests/equivalent_mutants.txt, and count as equivalent.
"""

import argparse
import ast
import os
import random
import re
import signal
import sys
import time
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
    "protocol": ("yahboomd/protocol", ["tests/protocol"]),
    "drive": ("yahboomd/drive", ["tests/drive"]),
    "odometry": ("yahboomd/odometry", ["tests/odometry"]),
    "messages": ("yahboomd/messages", ["tests/messages"]),
    "counts": ("yahboomd/counts.py", ["tests/test_counts.py"]),
    "model": ("yahboomd/model.py", ["tests/test_model.py"]),
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
LONGEST_S = 120.0
DECLARES = re.compile(r"^\s*class |TYPE_CHECKING|\(.*\*, ")


class Token(Operator):
    """Replaces one token by another."""

    def other(self, value):
        """The replacement of a token; None for one that stays."""
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
        """None."""
        return ()


class MinMax(Token):
    """The other end."""

    kind = parso.python.tree.Name

    def other(self, value):
        """See there."""
        return {"min": "max", "max": "min"}.get(value)


class Number(Token):
    """One more; twice as much where one more would hardly show."""

    kind = parso.python.tree.Number

    def other(self, value):
        """See there."""
        number = ast.literal_eval(value)
        return repr(number + 1 if abs(number) < 1 or number in range(10) else number * 2)


def operators():
    """Every change that is made."""
    provider = OperatorProvider()
    for kind, pairs in NEIGHBOURS.items():
        for pair in pairs.split():
            yield provider[f"Replace{kind}Operator_{pair}"]()
    for name in PLAIN.split():
        yield provider[name]()
    yield from (MinMax(), Number())


def places(path):
    """The places where one file can be changed: operator, number of its occurrence, and line.

    Not where classes are declared, and not the guard of `zip(strict=True)` against ourselves.
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


def change(path, operator, occurrence, line):
    """The changed text, and the line before and after; None where that is no Python."""
    source = path.read_text()
    changed = mutate_code(source, operator, occurrence)
    try:
        compile(changed, str(path), "exec", dont_inherit=True)
    except SyntaxError:
        return None
    before, after = (text.splitlines()[line - 1].strip() for text in (source, changed))
    return changed, before, after


def tested(path, changed, tests):
    """Run the tests in this process, which imports `changed` in place of the file at `path`."""
    module = ".".join(path.relative_to(HERE).with_suffix("").parts)
    code = compile(changed, str(path), "exec", dont_inherit=True)
    own = HERE / "tests" / path.relative_to(HERE / "yahboomd").with_name(f"test_{path.name}")
    read = machinery.SourceFileLoader.get_code
    machinery.SourceFileLoader.get_code = lambda loader, name: (
        code if name == module else read(loader, name)
    )
    quiet = ["-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", "-p", "no:xdist"]
    # What is imported before pytest is no reason to fail.
    quiet += ["-o", "filterwarnings=", "-m"]
    return int(
        pytest.main([*quiet, "not realtime", *([str(own)] * own.exists()), *tests], [Unshrunk()])
    )


class Unshrunk:
    """Hypothesis looks for no smaller example of what fails."""

    def pytest_configure(self):
        """Load a profile after conftest.py did."""
        settings = hypothesis.settings
        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
        settings.register_profile("mutants", settings.default, phases=phases, database=None)
        settings.load_profile("mutants")


def killed(path, changed, tests):
    """Whether a test fails, or hangs, or cannot even start."""
    pid = os.fork()
    if not pid:
        os.setsid()
        silence = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silence, 1)
        os.dup2(silence, 2)
        os._exit(tested(path, changed, tests))
    due = time.monotonic() + LONGEST_S
    while time.monotonic() < due:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return status != 0
        time.sleep(0.02)
    os.killpg(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    return True


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
    sys.dont_write_bytecode = True
    where, tests = ROOMS[options.room]
    paths = sorted((HERE / where).rglob("*.py")) or [HERE / where]
    every = [place for path in paths if options.file in (None, path.name) for place in places(path)]
    equivalent = {
        tuple(part.strip() for part in line.split(" | ")[:3])
        for line in EQUIVALENT.read_text().splitlines()
        if not line.startswith("#")
    }
    random.Random(options.seed).shuffle(every)
    counted = Counter()
    for path, operator, occurrence, line in every:
        if options.sample and counted.total() == options.sample:
            break
        found = change(path, operator, occurrence, line)
        if found is None:
            continue
        changed, before, after = found
        name = str(path.relative_to(HERE))
        if killed(path, changed, tests):
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
