"""A configuration file of an older version becomes one of this version; a person's lines stay."""

from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.core.config import Config, read
from yahboomd.core.errors import ConfigError
from yahboomd.tools.config_migration import migration, write_migrated
from yahboomd.tools.schemas.reference import default_toml

OLD_SOURCES = """\
[command.sources.cmd_vel]
priority = 10

[command.sources."cmd_vel/teleop"]
priority = 100
timeout_s = 0.3
"""


def older_default_file() -> str:
    """The default file of a version that knew neither the page nor moves."""
    before, _, after = default_toml().partition("[command.sources.cmd_vel]\n")
    return f"{before}{OLD_SOURCES}\n# Rates{after.partition('# Rates')[2]}"


def test_an_older_default_file_gets_the_new_sources_and_loses_what_only_repeats(
    tmp_path: Path,
) -> None:
    path = tmp_path / "config.toml"
    text = older_default_file().replace("priority = 10\n", "priority = 11 # mine\n")
    path.write_text(text)
    found = migration(path)
    said = "\n".join(found.sentences)
    assert "cmd_vel/web: the page cannot drive" in said
    assert "cmd_vel/moves: yahboomd move cannot drive" in said
    path.write_text(found.after)
    sources = read(path, environ={}).config.command.sources
    assert sources["cmd_vel"].priority == 11
    assert {name: each for name, each in sources.items() if name != "cmd_vel"} == {
        name: each for name, each in Config().command.sources.items() if name != "cmd_vel"
    }
    assert "priority = 11 # mine" in found.after
    assert len(found.after.splitlines()) < 40
    # Once is enough.
    assert migration(path).sentences == ()


def test_changes_and_comments_of_a_person_stay_and_the_robot_is_the_same(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    changed = default_toml()
    for old, new in {
        'port = ""': '# the left socket, see the sticker\nport = "/dev/ttyUSB3"',
        "timeout_s = 0.5\n": "timeout_s = 0.4  # slippery floor\n",
        'listen = ["tcp/127.0.0.1:7448"]': 'listen = [\n  "tcp/127.0.0.1:7448", # here\n'
        '  "tcp/0.0.0.0:7500",\n]',
        "[estop]": "# whoever reads this: call Ada\n\n[estop]",
    }.items():
        assert changed.count(old) >= 1
        changed = changed.replace(old, new, 1)
    path.write_text(changed)
    before = read(path, environ={}).config
    found = migration(path)
    for line in (
        "# the left socket, see the sticker",
        'port = "/dev/ttyUSB3"',
        "timeout_s = 0.4  # slippery floor",
        '  "tcp/127.0.0.1:7448", # here',
        "# whoever reads this: call Ada",
    ):
        assert line in found.after.splitlines()
    assert "baudrate" not in found.after
    assert "[estop]" not in found.after
    path.write_text(found.after)
    assert read(path, environ={}).config == before


@pytest.mark.parametrize(
    "text",
    [
        "",
        '[serial]\nport = ""\n',
        # A person's own choice of sources.
        "[command.sources.joystick]\npriority = 1\n",
        "[command.sources.cmd_vel]\npriority = 1\n",
    ],
)
def test_a_file_that_a_person_wrote_needs_no_change(tmp_path: Path, text: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    assert migration(path) == (text, text, ())


def test_motors_beside_a_preset_stay_because_they_change_it(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(default_toml().replace('preset = ""', 'preset = "4wd"'))
    before = read(path, environ={}).config
    path.write_text(migration(path).after)
    assert read(path, environ={}).config == before
    assert "[chassis.motors]" in path.read_text()


def test_sources_in_braces_are_left_to_the_person(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(
        '[command]\nsources = { cmd_vel = { priority = 1 }, "cmd_vel/teleop" = { priority = 2 } }\n'
    )
    with pytest.raises(ConfigError, match=r"lacks cmd_vel/web.*header of its own"):
        migration(path)


def test_the_old_file_is_kept_and_the_new_one_has_its_mode(tmp_path: Path) -> None:
    path, real = tmp_path / "config.toml", tmp_path / "real.toml"
    real.write_text(older_default_file())
    real.chmod(0o640)
    path.symlink_to(real)
    found = migration(path)
    kept = write_migrated(path, found)
    assert kept.read_text() == found.before
    assert path.is_symlink()
    assert real.read_text() == found.after
    assert real.stat().st_mode & 0o777 == kept.stat().st_mode & 0o777 == 0o640


def test_a_file_with_a_mistake_or_none_is_named(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    with pytest.raises(ConfigError, match=r"config\.toml"):
        migration(path)
    path.write_text("[serial]\nport = 3\n")
    with pytest.raises(ConfigError, match=r"serial\.port"):
        migration(path)
