"""Finds processes that hold the port or do not answer, and explains how to end them."""

from __future__ import annotations

import os
import re
import shlex

FROZEN = {"T": "stopped by a signal", "t": "stopped by a debugger"}
"""The states of a process that obeys nothing, not even SIGTERM, until it continues."""


_UNIT = re.compile(r"/system\.slice/(?:\S+/)?([^/\s]+)\.service$", re.MULTILINE)
"""A system service in a process's list of control groups."""


def arguments(pid: int, *, proc: str = "/proc") -> list[str]:
    """The command line of a process; empty if it cannot be read."""
    try:
        with open(f"{proc}/{pid}/cmdline", "rb") as file:
            return os.fsdecode(file.read()).split("\0")[:-1]
    except OSError:
        return []


def is_yahboomd(pid: int, *, proc: str = "/proc") -> bool:
    """Whether a process runs yahboomd, by its own command or as ``python -m``."""
    return "yahboomd" in (os.path.basename(word) for word in arguments(pid, proc=proc)[:3])


def process_state(pid: int, *, proc: str = "/proc") -> str:
    """The kernel's letter for the state of a process; empty if there is no such process."""
    try:
        with open(f"{proc}/{pid}/stat", encoding="utf-8", errors="replace") as file:
            # The name stands in brackets, and may contain brackets itself.
            return file.read().rpartition(")")[2].split()[0]
    except (OSError, IndexError):
        return ""


def measuring(pid: int, *, proc: str = "/proc") -> str:
    """``setup`` or ``tune`` if the process is one of them; else empty."""
    words = [os.path.basename(word) for word in arguments(pid, proc=proc)[:4]]
    command = words[words.index("yahboomd") + 1 :][:1] if "yahboomd" in words else []
    return command[0] if command and command[0] in {"setup", "tune"} else ""


def is_guard(pid: int, *, proc: str = "/proc") -> bool:
    """Whether a process is a guard, which only stops wheels after a tool or daemon was killed."""
    words = arguments(pid, proc=proc)[:4]
    return any(word.endswith("yahboomd/tools/port/guard.py") for word in words)


def runtime_directory(pid: int, *, proc: str = "/proc") -> str:
    """``RUNTIME_DIRECTORY`` in the environment of a process; empty if it is not set."""
    try:
        with open(f"{proc}/{pid}/environ", "rb") as file:
            for each in os.fsdecode(file.read()).split("\0"):
                name, _, value = each.partition("=")
                if name == "RUNTIME_DIRECTORY":
                    return value.split(":")[0]
    except OSError:
        pass
    return ""


def serial_ports(pid: int, *, proc: str = "/proc") -> tuple[str, ...]:
    """The terminals that a process has open besides its standard streams."""
    found: dict[str, str] = {}
    try:
        for fd in os.listdir(f"{proc}/{pid}/fd"):
            found[fd] = os.readlink(f"{proc}/{pid}/fd/{fd}")
    except OSError:
        return ()
    standard = {found.get(fd) for fd in "012"} | {"/dev/tty", "/dev/pts/ptmx"}
    ports = (path for path in found.values() if path.startswith(("/dev/tty", "/dev/pts/")))
    return tuple(sorted({*ports} - standard))


def daemons(*, proc: str = "/proc") -> list[int]:
    """The processes of this machine that run ``yahboomd run``, as far as this user may see."""
    pids = (int(name) for name in os.listdir(proc) if name.isdigit())
    return [
        pid
        for pid in pids
        if is_yahboomd(pid, proc=proc) and "run" in arguments(pid, proc=proc)[:4]
    ]


def listener(endpoints: tuple[str, ...]) -> int | None:
    """The process of this machine that listens at one of the endpoints; None if none is seen."""
    # Imported here, because a direct stop of a port does without these slow modules.
    from yahboomd.core.bus.zenoh_sessions import port_holder
    from yahboomd.core.names import host_and_port, is_local

    for endpoint in endpoints:
        place = host_and_port(endpoint)
        if place is not None and is_local(endpoint):
            holder = port_holder(place[1])
            if holder is not None:
                return int(holder.rpartition("(")[2].rstrip(")"))
    return None


def suspended_listener(endpoints: tuple[str, ...]) -> int | None:
    """A suspended daemon of this machine that listens at one of the endpoints; else None."""
    pid = listener(endpoints)
    if pid is None or not is_yahboomd(pid) or process_state(pid) not in FROZEN:
        return None
    return pid


def restarting(endpoints: tuple[str, ...], *, proc: str = "/proc") -> str:
    """Explain how to restart the daemon that listens at one of these endpoints."""
    pid = listener(endpoints)
    if pid is None:
        return (
            "Restart the daemon: `sudo systemctl restart yahboomd` if it is the service, else "
            "Ctrl-C in its terminal, and start it again."
        )
    try:
        with open(f"{proc}/{pid}/cgroup", encoding="utf-8", errors="replace") as file:
            unit = _UNIT.search(file.read())
    except OSError:
        unit = None
    if unit is not None:
        return f"Restart the daemon: `sudo systemctl restart {unit[1]}`."
    return f"Restart the daemon: press Ctrl-C in its terminal (pid {pid}), and start it again."


def reaching(pid: int, *, proc: str = "/proc") -> str:
    """Name a daemon's port, and the command that stops it; empty if it has no port."""
    ports = serial_ports(pid, proc=proc)
    if not ports:
        return ""
    folder = runtime_directory(pid, proc=proc)
    where = f"RUNTIME_DIRECTORY={shlex.quote(folder)} " if folder else ""
    return (
        f"yahboomd (pid {pid}) holds {ports[0]} and is reached by: "
        f"{where}yahboomd stop --port {ports[0]}"
    )


def true_names(text: str, *, proc: str = "/proc") -> str:
    """Replace ``python (pid N)`` by ``yahboomd (pid N)`` or its guard, if it is one.

    The kernel names a Python program after the interpreter.
    """

    def named(found: re.Match[str]) -> str:
        pid = int(found["pid"])
        if is_guard(pid, proc=proc):
            return f"yahboomd's guard (pid {pid})"
        if not is_yahboomd(pid, proc=proc):
            return found[0]
        return f"{' '.join(('yahboomd', measuring(pid, proc=proc))).rstrip()} (pid {pid})"

    return _PYTHON.sub(named, text)


def suspended(pid: int, again: str, *, proc: str = "/proc") -> tuple[str, str]:
    """Message and remedy for a suspended daemon.

    Args:
        again: The command to repeat once the daemon runs again.
    """
    message = f"yahboomd (pid {pid}) is suspended and cannot answer."
    if serial_ports(pid, proc=proc):
        # A daemon that suspended itself has stopped the wheels and closed its port.
        message += " It has not let its port go: the wheels keep their last speed."
        remedy = f"Stop them: yahboomd stop\nOr continue it with `fg` or `kill -CONT {pid}`"
    else:
        remedy = f"Continue it with `fg` or `kill -CONT {pid}`"
    return message, f"{remedy}, then repeat: {again}"


def unresponsive(name: str, pid: int, state: str, again: str) -> tuple[str, str]:
    """Message and remedy for a process that does not answer.

    Args:
        name: The process, in a sentence.
        state: From :func:`process_state`.
        again: The command that stops the wheels once it has ended.
    """
    if state in FROZEN:
        how = FROZEN[state]
        message = f"{name} is frozen ({how}, state {state}): the wheels keep their last speed."
        remedy = (
            f"End it and stop the wheels: kill -9 {pid}; {again}\n"
            f"Or let it go on, and stop it then: kill -CONT {pid}; {again}"
        )
        return message, remedy
    doing = f" (state {state})" if state else ""
    remedy = (
        f"End it, which stops the wheels: kill {pid}\n"
        f"If it does not end within 5 s: kill -9 {pid}; {again}"
    )
    return f"{name} does not answer{doing}.", remedy


_PYTHON = re.compile(r"\b(?:python[\d.]*|yahboomd|yahboomd-guard) \(pid (?P<pid>\d+)\)")
