"""Coverage-guided fuzzing of every parser of foreign bytes: `make fuzz MINUTES=8`.

Each target of tests/plugins/fuzz_targets.py runs in a process of its own for its share of the
time, starting from tests/fuzz/corpus/TARGET and the finds of earlier runs (.fuzz/TARGET). An input
that breaks a law is stored as .fuzz/TARGET/crash-... and named; the exit status is then 1.

Needs atheris, which has wheels for CPython 3.11 to 3.13 on x86-64 Linux.
"""

import argparse
import os
import re
import subprocess
import sys

HERE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
PLUGINS = os.path.join(HERE, "tests", "plugins")
CORPUS = os.path.join(HERE, "tests", "fuzz", "corpus")
LONGEST = 4200  # slightly more than a command may have
MEMORY_MB = 1024  # libFuzzer ends a target that takes more


def child(target, arguments):
    """Fuzz one target in this process; libFuzzer never returns."""
    import atheris

    sys.path[:0] = [PLUGINS, HERE]
    with atheris.instrument_imports(include=["yahboomd", "fuzz_targets"]):
        import fuzz_targets

    check = fuzz_targets.TARGETS[target]
    atheris.Setup(["fuzz", *arguments], check)
    atheris.Fuzz()


def run(target, seconds, seed, found):
    """Fuzz one target in a child; returns its last output and its status."""
    os.makedirs(found, exist_ok=True)
    command = [
        *(sys.executable, os.path.abspath(__file__), "--child", target),
        *("-max_total_time=%d" % seconds, "-max_len=%d" % LONGEST, "-timeout=10"),
        *("-rss_limit_mb=%d" % MEMORY_MB, "-print_final_stats=1", "-seed=%d" % seed),
        *("-artifact_prefix=%s/" % found, found, os.path.join(CORPUS, target)),
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    ) as process:
        try:
            output, _ = process.communicate(timeout=seconds + 120)
        finally:
            if process.poll() is None:
                process.kill()
    return output, process.returncode


def figure(pattern, output):
    found = re.findall(pattern, output)
    return int(found[-1]) if found else 0


def main():
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2], sys.argv[3:])
        return 1
    parser = argparse.ArgumentParser(description="fuzz everything that reads foreign bytes")
    parser.add_argument("--minutes", type=float, default=2.0, help="for all targets together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--targets", default="", help="only these, separated by commas")
    args = parser.parse_args()
    try:
        import atheris  # noqa: F401
    except ImportError:
        sys.stderr.write(
            "yahboomd: fuzzing needs atheris, which is not there for this Python (%d.%d on %s). "
            "It has wheels for CPython 3.11 to 3.13 on x86-64 Linux: pip install 'yahboomd[fuzz]'. "
            "The corpus itself is replayed by the checks without it.\n"
            % (sys.version_info[0], sys.version_info[1], os.uname().machine)
        )
        return 1
    sys.path[:0] = [PLUGINS, HERE]
    import fuzz_targets

    targets = [name for name in args.targets.split(",") if name] or list(fuzz_targets.TARGETS)
    seconds = max(1, int(args.minutes * 60.0 / len(targets)))
    total, broken = 0, []
    print("%-10s %12s %10s %9s  %s" % ("target", "inputs", "a second", "peak MB", "found"))
    for target in targets:
        found = os.path.join(HERE, ".fuzz", target)
        output, status = run(target, seconds, args.seed, found)
        tried = figure(r"stat::number_of_executed_units:\s*(\d+)", output)
        total += tried
        crashes = sorted(set(re.findall(r"Test unit written to (\S+)", output)))
        words = "nothing" if status == 0 else ", ".join(crashes) or "ended with %d" % status
        print(
            "%-10s %12d %10d %9d  %s"
            % (
                target,
                tried,
                figure(r"stat::average_exec_per_sec:\s*(\d+)", output),
                figure(r"stat::peak_rss_mb:\s*(\d+)", output),
                words,
            ),
            flush=True,
        )
        if status != 0:
            broken.append(target)
            print("\n".join(output.splitlines()[-40:]))
    print("%d inputs tried" % total)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
