"""The text format of metrics: OpenMetrics 1.0, or Prometheus' older format on request.

The two differ in a few lines: OpenMetrics names a counter without ``_total``, knows units and the
type ``info``, and ends with ``# EOF``. Sources:
https://prometheus.io/docs/specs/om/open_metrics_spec/ and
https://prometheus.io/docs/instrumenting/exposition_formats/
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Literal, TypeAlias

OPENMETRICS = "application/openmetrics-text; version=1.0.0; charset=utf-8"
CLASSIC = "text/plain; version=0.0.4; charset=utf-8"

Kind: TypeAlias = Literal["counter", "gauge", "info"]

MAX_LABEL = 128
"""The most characters of a label's value, because some values come from other programs."""

_NAME = re.compile(r"[a-z][a-z0-9_]*\Z")
_SUFFIX: Mapping[Kind, str] = {"counter": "_total", "gauge": "", "info": "_info"}
_CLASSIC_KIND: Mapping[Kind, str] = {"counter": "counter", "gauge": "gauge", "info": "gauge"}
_QUOTED = str.maketrans({"\\": r"\\", "\n": r"\n", '"': r"\""})
_HELP = str.maketrans({"\\": r"\\", "\n": r"\n"})


class Family:
    """All series of one name.

    Args:
        name: Without the suffix of its kind, with its unit at the end.
        kind: Counter, gauge, or an info, whose labels carry the information.
        unit: A base unit in the plural, such as ``seconds``; empty for a plain number.
    """

    def __init__(self, name: str, kind: Kind, meaning: str, unit: str = "") -> None:
        self.name = name
        self.kind = kind
        self.meaning = meaning
        self.unit = unit
        self._series: dict[tuple[tuple[str, str], ...], float] = {}

    def set(self, value: float, labels: Mapping[str, str]) -> None:
        """Set the series with these labels; no two series have the same."""
        kept = tuple((name, text[:MAX_LABEL]) for name, text in labels.items() if text)
        self._series[kept] = value

    def lines(self, *, openmetrics: bool) -> list[str]:
        """The family as text; empty without series."""
        if not self._series:
            return []
        full = self.name + _SUFFIX[self.kind]
        title = self.name if openmetrics else full
        kind = self.kind if openmetrics else _CLASSIC_KIND[self.kind]
        meaning = self.meaning.translate(_HELP if not openmetrics else _QUOTED)
        lines = [f"# HELP {title} {meaning}", f"# TYPE {title} {kind}"]
        if openmetrics and self.unit:
            lines.append(f"# UNIT {title} {self.unit}")
        for labels, value in self._series.items():
            inside = ",".join(f'{name}="{text.translate(_QUOTED)}"' for name, text in labels)
            lines.append(f"{full}{{{inside}}} {_number(value)}")
        return lines


class Exposition:
    """Families in the order of their first use, each with the series of all robots."""

    def __init__(self) -> None:
        self._families: dict[str, Family] = {}

    def family(self, name: str, kind: Kind, meaning: str, unit: str = "") -> Family:
        """The family of a name; the first call decides about kind, meaning and unit.

        Raises:
            ValueError: Its name or unit violate the format.
        """
        known = self._families.get(name)
        if known is None:
            if not _NAME.match(name) or (unit and not name.endswith(unit)):
                raise ValueError(f"{name} cannot be the name of a metric in {unit or 'no unit'}")
            known = self._families[name] = Family(name, kind, meaning, unit)
        return known

    def text(self, *, openmetrics: bool) -> str:
        """All families in one of the two formats."""
        lines = [
            line
            for family in self._families.values()
            for line in family.lines(openmetrics=openmetrics)
        ]
        if openmetrics:
            lines.append("# EOF")
        return "".join(f"{line}\n" for line in lines)


def wants_openmetrics(accept: str) -> bool:
    """Whether a scraper's Accept header asks for OpenMetrics; else it gets the older format."""
    return "application/openmetrics-text" in accept.lower()


def _number(value: float) -> str:
    if isinstance(value, int):
        return str(int(value))
    if math.isfinite(value):
        return repr(value)
    return "NaN" if math.isnan(value) else f"{'+' if value > 0 else '-'}Inf"
