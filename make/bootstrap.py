"""Creates the virtual environment for `make`, or reports in one sentence why it cannot.

Written for any Python from 2.7 on, so that an old one gets the sentence and not a SyntaxError.
"""

import os
import subprocess
import sys

OLDEST = (3, 11)


NEWEST = (3, 14)


def fail(sentence):
    sys.stderr.write("yahboomd: %s\n" % sentence)
    sys.exit(1)


def output(*command):
    """What a command prints, or nothing if it fails or does not exist."""
    try:
        running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    except OSError:
        return ""
    printed = running.communicate()[0].decode().strip()
    return printed if running.returncode == 0 else ""


def newer():
    """A Python on this machine that is new enough, also one that uv installed; or nothing."""
    print_it = "import sys; print(sys.executable)"
    for minor in range(NEWEST[1], OLDEST[1] - 1, -1):
        found = output(
            "python%d.%d" % (OLDEST[0], minor), "-c", "import ensurepip, venv; " + print_it
        )
        if found:
            return found
    wanted = ("python", "find", ">=%d.%d" % OLDEST)
    return output("uv", *wanted) or output(sys.executable, "-m", "uv", *wanted)


def check():
    """The Python to use: this one, or a newer one if this is too old."""
    if sys.version_info < OLDEST:
        found = newer()
        if not found:
            fail(
                "this is Python %d.%d, and yahboomd needs %d.%d or later. uv brings one, also to "
                "Ubuntu 22.04; make finds it: sudo apt install python3-pip && python3 -m pip "
                "install --user uv && python3 -m uv python install 3.12 (or name one that you "
                "have: make PYTHON=/path/to/python3.12 ...)"
                % (sys.version_info[0], sys.version_info[1], OLDEST[0], OLDEST[1])
            )
        sys.stdout.write(
            "yahboomd: this is Python %d.%d, which is too old; %s is used\n"
            % (sys.version_info[0], sys.version_info[1], found)
        )
        return found
    try:
        import ensurepip  # noqa: F401
        import venv  # noqa: F401
    except ImportError:
        fail(
            "this Python has no working venv module. Install it with: sudo apt install python3-venv"
        )
    return sys.executable


def works(python):
    """Whether an environment exists and has pip, which an interrupted one may lack."""
    if not os.path.exists(python):
        return False
    with open(os.devnull, "w") as nowhere:
        call = [python, "-m", "pip", "--version"]
        return subprocess.call(call, stdout=nowhere, stderr=nowhere) == 0


def main():
    if len(sys.argv) < 3:
        fail("usage: bootstrap.py FOLDER EXTRAS [PACKAGE ...]")
    folder, extras, packages = sys.argv[1], sys.argv[2], sys.argv[3:]
    base = check()
    python = os.path.join(folder, "bin", "python")
    if not works(python):
        sys.stdout.write("yahboomd: making a virtual environment in %s\n" % folder)
        sys.stdout.flush()
        make = [base, "-m", "venv", folder]
        if os.path.exists(os.path.join(folder, "pyvenv.cfg")):
            # Clears an environment only, never another folder.
            make.append("--clear")
        if subprocess.call(make) != 0:
            fail("the virtual environment could not be made in %s; see above." % folder)
    sys.stdout.write("yahboomd: installing its packages (a minute, the first time)\n")
    sys.stdout.flush()
    targets = [".[%s]" % extras if extras else "."]
    targets.extend(packages)
    pip = [python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    for target in targets:
        pip += ["-e", target]
    if subprocess.call(pip) != 0:
        fail("pip could not install the packages; its own words are above. Is there a network?")


if __name__ == "__main__":
    main()
