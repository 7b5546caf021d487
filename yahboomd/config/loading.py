"""From a file, the environment and ``--set`` to a :class:`Config`, or to every mistake at once."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from yahboomd.config.layers import NOWHERE, Layers, Origin
from yahboomd.config.mistakes import Mistake, place_of, takes_texts, words_for
from yahboomd.config.models import Config
from yahboomd.config.rules import Finding, findings
from yahboomd.config.values import Place, dotted
from yahboomd.errors import ConfigError

STANDARD_PATH = Path("/etc/yahboomd/config.toml")
"""Read when no file is named, where it exists."""

_ROUNDS = 20
"""Repairs before the rules; each takes away one level around what cannot be read."""


@dataclass(frozen=True)
class Loaded:
    """A configuration, and how it came about.

    Attributes:
        config: What holds.
        path: The file that was read, if any.
        origins: Where each key was written; others are defaults.
        warnings: Sentences about what works and may surprise.
    """

    config: Config
    path: Path | None = None
    origins: Mapping[Place, Origin] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def load(path: Path | None, *, environ: Mapping[str, str], overrides: Sequence[str] = ()) -> Config:
    """Read the configuration.

    Precedence: ``overrides``, environment (``YAHBOOMD_SECTION__KEY``), file, default.

    Args:
        path: A TOML file that must exist; None for ``/etc/yahboomd/config.toml``, if it does.
        environ: The environment variables.
        overrides: ``section.key=value``, as given to ``--set``.

    Raises:
        ConfigError: Naming every mistake, each on a line with its origin.
    """
    return read(path, environ=environ, overrides=overrides).config


def read(
    path: Path | None,
    *,
    environ: Mapping[str, str],
    overrides: Sequence[str] = (),
    standard_path: Path = STANDARD_PATH,
) -> Loaded:
    """Read the configuration, and say where its values come from; see :func:`load`.

    Raises:
        ConfigError: Naming every mistake, each on a line with its origin.
    """
    if path is None and _is_there(standard_path):
        path = standard_path
    layers = Layers(Config().model_dump(mode="json", exclude_none=True))
    if path is not None:
        layers.read_file(path)
    layers.read_environment(environ)
    layers.read_overrides(overrides)

    mistakes = [Mistake(origin, "", words) for origin, words in layers.mistakes]
    config, wrong = _values(layers)
    mistakes += wrong.values()
    warnings = []
    for finding in findings(config):
        looked_at = (finding.place, *finding.beside)
        if any(_overlap(place, bad) for place in looked_at for bad in wrong):
            continue
        found = Mistake(_blame(layers, finding), dotted(finding.place), finding.words)
        if finding.is_warning:
            warnings.append(str(found))
        else:
            mistakes.append(found)
    if mistakes:
        raise ConfigError(_message(mistakes))
    if config.chassis.preset:
        # What the preset filled in comes from where the preset does.
        layers.forget(("chassis", "kinematics"))
        layers.forget(("chassis", "motors"))
        layers.origins |= dict.fromkeys(
            (("chassis", "kinematics"), ("chassis", "motors")),
            layers.origin(("chassis", "preset")),
        )
    return Loaded(config.resolved(), path, layers.origins, tuple(warnings))


def _is_there(path: Path) -> bool:
    # One that may not be read is there: falling back to the defaults would be a surprise.
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:
        return True
    return True


def _values(layers: Layers) -> tuple[Config, dict[Place, Mistake]]:
    """The configuration as far as its values are valid, and what is wrong with the others.

    What cannot be read is taken away, and the rest looked at again, so that the rules see all of
    what is left: a person wants to hear of every mistake in one go.
    """
    data = copy.deepcopy(layers.data)
    wrong: dict[Place, Mistake] = {}
    for _ in range(_ROUNDS):
        try:
            return Config.model_validate(data), wrong
        except ValidationError as invalid:
            errors = invalid.errors(include_url=False)
        for error in errors:
            place = place_of(error)
            if _take_text(data, layers, place, error["type"]):
                continue
            if not any(_overlap(place, known) for known in wrong):
                wrong[place] = Mistake(layers.origin(place), dotted(place), words_for(error))
        for place in wrong:
            _take_away(data, place)
    return Config(), wrong | {(): Mistake(NOWHERE, "", "cannot be read")}


def _take_text(data: dict[str, Any], layers: Layers, place: Place, kind: str) -> bool:
    """Where text is wanted, what the environment or ``--set`` gave in letters is that text.

    A list of texts may be given without the quotes and brackets that shells and make take away.
    """
    text = layers.texts.get(place)
    table = _table_of(data, place)
    if text is None or table is None:
        return False
    if kind == "tuple_type" and isinstance(table[place[-1]], str) and takes_texts(place):
        bare = text.strip().removeprefix("[").removesuffix("]")
        table[place[-1]] = [entry.strip() for entry in bare.split(",") if entry.strip()]
        return True
    if kind not in {"string_type", "literal_error"} or isinstance(table[place[-1]], str):
        return False
    table[place[-1]] = text
    return True


def _take_away(data: dict[str, Any], place: Place) -> None:
    # Entries of a list go with their list, so that the others keep their numbers; an entry that
    # lacks something goes with its table.
    if any(isinstance(part, int) for part in place):
        place = place[: next(i for i, part in enumerate(place) if isinstance(part, int))]
    while len(place) > 1 and (_table_of(data, place) is None):
        place = place[:-1]
    table = _table_of(data, place)
    if table is not None:
        del table[place[-1]]


def _table_of(data: dict[str, Any], place: Place) -> dict[Any, Any] | None:
    """The table that holds the last key of ``place``; None where it does not."""
    table: Any = data
    for part in place[:-1]:
        # Places come from pydantic, which found these keys and entries there itself.
        if not isinstance(table, dict | list):
            return None
        try:
            table = table[part]  # type: ignore[index]
        except LookupError:
            return None
    return table if isinstance(table, dict) and place and place[-1] in table else None


def _overlap(one: Place, other: Place) -> bool:
    shorter = min(len(one), len(other))
    return one[:shorter] == other[:shorter]


def _blame(layers: Layers, finding: Finding) -> Origin:
    """Where the contradiction was written: at the key itself, else at the one it contradicts."""
    for place in (finding.place, *finding.beside):
        if place in layers.origins:
            return layers.origins[place]
    return max(layers.origin(place) for place in (finding.place, *finding.beside))


def _message(mistakes: list[Mistake]) -> str:
    lines = [str(mistake) for mistake in sorted(mistakes)]
    count = "a mistake" if len(lines) == 1 else f"{len(lines)} mistakes"
    return "\n".join([f"The configuration has {count}:", *lines])
