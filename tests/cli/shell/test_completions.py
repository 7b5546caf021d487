"""`yahboomd completions`."""

from __future__ import annotations

import pytest

from yahboomd.cli.main import main
from yahboomd.cli.shell.command_tree import whole
from yahboomd.cli.shell.completion_scripts import SCRIPTS


@pytest.mark.parametrize("shell", SCRIPTS)
def test_it_prints_the_script_of_a_shell(shell: str, capsys) -> None:
    assert main(["completions", shell]) == 0
    assert capsys.readouterr().out == SCRIPTS[shell](whole())


def test_another_shell_is_a_mistake_that_names_those_that_there_are(capsys) -> None:
    with pytest.raises(SystemExit) as left:
        main(["completions", "tcsh"])
    assert left.value.code == 2
    assert "bash" in capsys.readouterr().err
