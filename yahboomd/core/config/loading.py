"""Reads a file, the environment and ``--set`` into a :class:`Config`, or names every mistake."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from yahboomd import __version__
from yahboomd.core.config.layers import NOWHERE, Layers, Origin, plain
from yahboomd.core.config.models import Config, calibration_path
from yahboomd.core.config.rules import Finding, findings
from yahboomd.core.config.values import Place, dotted
from yahboomd.core.errors import ConfigError
from yahboomd.core.program import STANDARD_PATH

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails


@dataclass(frozen=True)
class Loaded:
    """A configuration and its sources.

    Attributes:
        layers: The layers that it was read from.
        path: The file that was read, if any.
        warnings: Sentences about settings that work but may surprise.
        calibration_path: The path of its calibration, which need not exist; None without a state
            directory.
    """

    config: Config
    layers: Layers
    path: Path | None = None
    warnings: tuple[str, ...] = ()
    calibration_path: Path | None = None

    @property
    def origins(self) -> Mapping[Place, Origin]:
        """The origin of each key that was written. Slow: reads the file's text again."""
        found = self.layers.origins
        if not self.config.chassis.preset:
            return found
        # The preset filled these in.
        filled = (("chassis", "kinematics"), ("chassis", "motors"))
        kept = {place: origin for place, origin in found.items() if place[:2] not in filled}
        return kept | dict.fromkeys(filled, self.layers.origin(("chassis", "preset")))


def read(
    path: Path | None,
    *,
    environ: Mapping[str, str],
    overrides: Sequence[str] = (),
    standard_path: Path = STANDARD_PATH,
) -> Loaded:
    """Read the configuration, with the origin of each value.

    Precedence: ``overrides``, environment (``YAHBOOMD_SECTION__KEY``), calibration, file, default.

    Args:
        path: A TOML file that must exist; None for ``standard_path``, if it does.
        environ: The environment variables.
        overrides: ``section.key=value``, as given to ``--set``.
        standard_path: For tests.

    Raises:
        ConfigError: Naming every mistake, each on a line with its origin.
    """
    if path is None and _is_there(standard_path):
        path = standard_path
    layers = Layers(Config().as_data())
    if path is not None:
        layers.read_file(path)
    layers.read_environment(environ)
    layers.read_overrides(overrides)

    config, errors = _validated(layers.data)
    if errors and _take_texts(layers, errors):
        config, errors = _validated(layers.data)
    mistakes, wrong = list(layers.mistakes), _wrong(layers, errors)
    mistakes += wrong.values()
    if wrong:
        # The rules see the rest, so that all mistakes are reported at once.
        for place in wrong:
            _remove(layers.data, place)
        config, _ = _validated(layers.data)
    warnings: list[tuple[Origin, str]] = []
    calibrated_at = calibration_path(config, environ, path, user_id=os.geteuid())
    if calibrated_at is not None and not mistakes and _is_there(calibrated_at):
        if ignored := _calibrate(layers, config, calibrated_at):
            warnings.append((NOWHERE, ignored))
        config, _ = _validated(layers.data)
    for finding in findings(config):
        if any(_overlap(place, bad) for place in (finding.place, *finding.beside) for bad in wrong):
            continue
        found = _blame(layers, finding), f"{dotted(finding.place)}: {finding.words}"
        (warnings if finding.is_warning else mistakes).append(found)
    if mistakes:
        count = "a mistake" if len(mistakes) == 1 else f"{len(mistakes)} mistakes"
        raise ConfigError("\n".join([f"The configuration has {count}:", *_lines(sorted(mistakes))]))
    return Loaded(config.resolved(), layers, path, tuple(_lines(warnings)), calibrated_at)


def read_foreign(data: object, owner: str) -> Config:
    """The configuration of another yahboomd, which may be another version.

    Args:
        owner: Its owner, as the beginning of a sentence.

    Raises:
        ConfigError: This version does not know such a configuration.
    """
    version = ""
    if isinstance(data, dict):
        # The answer of the service has its version beside its sections.
        version, data = data.get("version", ""), {k: v for k, v in data.items() if k != "version"}
    config, errors = _validated(data)
    if errors:
        place, why = dotted(errors[0]["loc"]), errors[0]["msg"]
        raise ConfigError(
            f"{owner} has a configuration{f' of version {version}' if version else ''} that "
            f"yahboomd {__version__} cannot use: {place}: {why}.",
            remedy="Use the same version of yahboomd there and here.",
        )
    return config


def _calibrate(layers: Layers, config: Config, path: Path) -> str:
    from yahboomd.core.config.calibration_file import difference, read_calibration

    try:
        calibration = read_calibration(path)
    except ConfigError as error:
        return f"{error} It is ignored: the robot drives uncalibrated."
    if changed := difference(calibration, config):
        return (
            f"{path} is ignored: it was made for another robot ({changed}). Calibrate again, or "
            "remove it with `yahboomd calibrate undo`."
        )
    words = f"{path} ({calibration.method}, {calibration.made})"
    for key, value in calibration.chassis.as_data().items():
        layers.take(("chassis", key), value, words)
    return ""


def _is_there(path: Path) -> bool:
    # One that may not be read is there: falling back to the defaults would be a surprise.
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:
        return True
    return True


def _lines(mistakes: Sequence[tuple[Origin, str]]) -> list[str]:
    return [plain(": ".join(filter(None, (origin.words, words)))) for origin, words in mistakes]


def _validated(data: object) -> tuple[Config, list[ErrorDetails]]:
    try:
        return Config.model_validate(data), []
    except ValidationError as invalid:
        return Config(), invalid.errors(include_url=False)


def _wrong(layers: Layers, errors: list[ErrorDetails]) -> dict[Place, tuple[Origin, str]]:
    wrong: dict[Place, tuple[Origin, str]] = {}
    for error in errors:
        # Only here: the words for mistakes take longer to load than a configuration without any.
        from yahboomd.core.config.mistakes import place_of, words_for

        place = place_of(error)
        if error["type"] == "too_short" and any(bad[: len(place)] == place for bad in wrong):
            # Wrong entries do not count.
            continue
        mistake = f"{dotted(place)}: {words_for(error)}"
        wrong.setdefault(place, (layers.origin(place), mistake))
    return wrong


def _take_texts(layers: Layers, errors: list[ErrorDetails]) -> bool:
    """Take values of environment and ``--set`` as text if TOML took them for something else.

    A list of texts may be given without the quotes and brackets that shells and make take away.
    """
    taken = False
    for error in errors:
        place, value = error["loc"], error["input"]
        if place not in layers.written:
            continue
        _, text = layers.written[place]
        table: Any = layers.data
        for part in place[:-1]:
            table = table[part]
        if error["type"] == "tuple_type" and isinstance(value, str):
            bare = value.strip().removeprefix("[").removesuffix("]")
            table[place[-1]] = [entry.strip() for entry in bare.split(",") if entry.strip()]
        elif error["type"] == "string_type":
            table[place[-1]] = text
        else:
            continue
        taken = True
    return taken


def _remove(data: dict[str, Any], place: Place) -> None:
    """Remove a wrong value: from its table, or with the list that it is in."""
    table: Any = data
    for part, below in zip(place, (*place[1:], None), strict=True):
        inner = table.get(part)
        if isinstance(inner, dict) and below in inner:
            table = inner
            continue
        table.pop(part, None)
        return


def _overlap(one: Place, other: Place) -> bool:
    shorter = min(len(one), len(other))
    return one[:shorter] == other[:shorter]


def _blame(layers: Layers, finding: Finding) -> Origin:
    """The origin of a contradiction: the key itself, else the one that it contradicts."""
    places = (finding.place, *finding.beside)
    for place in places:
        if place in layers.origins:
            return layers.origins[place]
    return max(map(layers.origin, places))
