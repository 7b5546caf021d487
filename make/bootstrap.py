"""Creates the virtual environment for `make`, or reports in one sentence why it cannot.

Written for any Python from 2.7 on, so that an old one gets the sentence and not a SyntaxError.
"""

import os
import subprocess
import sys

OLDEST = (3, 11)


def fail(sentence):
    sys.stderr.write("yahboomd: %s\n" % sentence)
    sys.exit(1)


def check():
    if sys.version_info < OLDEST:
        fail(
            "this is Python %d.%d, and yahboomd needs %d.%d or later. Point make at a newer one "
            "(make PYTHON=python3.12 ...), or see docs/install.md for Ubuntu 22.04."
            % (sys.version_info[0], sys.version_info[1], OLDEST[0], OLDEST[1])
        )
    try:
        import ensurepip  # noqa: F401
        import venv  # noqa: F401
    except ImportError:
        fail(
            "this Python has no working venv module. Install it with: sudo apt install python3-venv"
        )


def works(python):
    """Whether an environment exists and has pip, which an interrupted one may lack."""
    if not os.path.exists(python):
        return False
    with open(os.devnull, "w") as nowhere:
        call = [python, "-m", "pip", "--version"]
        return subprocess.call(call, stdout=nowhere, stderr=nowhere) == 0


def main():
    if len(sys.argv) != 3:
        fail("usage: bootstrap.py FOLDER EXTRAS")
    folder, extras = sys.argv[1], sys.argv[2]
    check()
    python = os.path.join(folder, "bin", "python")
    if not works(python):
        sys.stdout.write("yahboomd: making a virtual environment in %s\n" % folder)
        sys.stdout.flush()
        make = [sys.executable, "-m", "venv", folder]
        if os.path.exists(os.path.join(folder, "pyvenv.cfg")):
            # Clears an environment only, never another folder.
            make.append("--clear")
        if subprocess.call(make) != 0:
            fail("the virtual environment could not be made in %s; see above." % folder)
    sys.stdout.write("yahboomd: installing its packages (a minute, the first time)\n")
    sys.stdout.flush()
    target = ".[%s]" % extras if extras else "."
    pip = [python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "-e", target]
    if subprocess.call(pip) != 0:
        fail("pip could not install the packages; its own words are above. Is there a network?")


if __name__ == "__main__":
    main()
