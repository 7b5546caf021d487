"""`make fleet-rollout`: tests the rollout of extras/fleet/ansible on robots with a real systemd.

Prepares what `make system-test` does, and beside it, in the same cache:

- a copy of its Debian with an SSH server and python3-apt, as the systems of robots have;
- ansible-core, in an environment of its own.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import plug_test
import system_test
from system_test import TREE, Impossible

ANSIBLE = "ansible-core>=2.17,<2.20"


def main() -> int:
    system_test.NEEDED.update({"ssh": "openssh-client"})
    try:
        cache = system_test.prepare_cache()
        system_test.install_tools()
        root = system_test.make_root(cache, "bookworm")
        package = system_test.build_package(TREE, cache / "packages-rollout", root)
        reached = plug_test.with_packages(cache, root, "ssh", "openssh-server python3-apt")
        programs = _ansible(cache / "ansible")
    except Impossible as why:
        sys.stderr.write(f"fleet-rollout: not run: {why}\n")
        return 1
    return subprocess.call(
        [
            sys.executable,
            "-m",
            "pytest",
            "extras/fleet/tests/system",
            *sys.argv[1:],
        ],
        cwd=TREE,
        env={
            **os.environ,
            "YAHBOOMD_SYSTEM_ROOT": str(reached),
            "YAHBOOMD_SYSTEM_PACKAGE": str(package),
            "YAHBOOMD_ANSIBLE": str(programs),
        },
    )


def _ansible(home: Path) -> Path:
    """The folder of Ansible's programs; installed once."""
    programs = home / "bin"
    if not (programs / "ansible-playbook").exists():
        print(f"installing {ANSIBLE} into {home} (once)", flush=True)
        subprocess.check_call([sys.executable, "-m", "venv", "--clear", str(home)])
        if subprocess.call([str(programs / "pip"), "install", "--quiet", ANSIBLE]) != 0:
            raise Impossible("ansible-core could not be installed; see above.")
    return programs


if __name__ == "__main__":
    sys.exit(main())
