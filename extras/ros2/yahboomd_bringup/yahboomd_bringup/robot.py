"""The robot as yahboomd's command line describes it: no size and no limit is written twice."""

import json
import os
import subprocess
from typing import Any, Dict

import yaml

Tree = Dict[str, Any]


class BringupError(RuntimeError):
    """Something that has to be changed before the robot can be brought up."""


class Robot:
    """One robot's configuration.

    Args:
        config: Its file; "" is the one that the service reads.
        command: The program, if it is not on the PATH.
        distro: The distribution of ROS 2; "": the one that is sourced, else the configuration's.
    """

    def __init__(self, config: str = "", command: str = "yahboomd", distro: str = "") -> None:
        """Ask for the configuration.

        Raises:
            BringupError: The program is not there, it does not know the distribution, or the
                configuration has mistakes.
        """
        self.command = command
        distro = distro or os.environ.get("ROS_DISTRO", "")
        self.options = ["--config", config] if config else []
        self.options += ["--set", f'ros2.distro="{distro}"'] if distro else []
        try:
            self.facts: Tree = json.loads(self._ask("show", "--json"))
        except BringupError as error:
            if "ros2.distro" not in str(error):
                raise
            raise BringupError(f"{error}\nTo launch it as another one: distro:=NAME") from error

    @property
    def namespace(self) -> str:
        """The robot's name on the bus, and the namespace of its topics."""
        return str(self.facts["zenoh"]["namespace"])

    @property
    def joystick_source(self) -> str:
        """The key that a person commands on: the one of the greatest priority."""
        sources = self.facts["command"]["sources"]
        return str(max(sources, key=lambda name: sources[name]["priority"]))

    def urdf(self) -> str:
        """The model."""
        return self._ask("urdf")

    def parameters(self, package: str) -> Tree:
        """What the nodes of a package have to know of the base."""
        return dict(yaml.safe_load(self._ask("parameters", package)))

    def _ask(self, *words: str) -> str:
        asked = [self.command, "config", *words, *self.options]
        try:
            answer = subprocess.run(asked, capture_output=True, text=True, check=False)
        except OSError as error:
            raise BringupError(
                f"{self.command} cannot be started ({error.strerror}). Install yahboomd on this "
                "machine too, or name the program: yahboomd:=/path/to/yahboomd."
            ) from error
        if answer.returncode:
            raise BringupError(f"{' '.join(asked)}: {answer.stderr.strip()}")
        return answer.stdout
