"""JSON from outside: NaN, infinity, numbers of thousands of digits and endless nesting are refused."""

import json
import math
import re
from typing import Any, NoReturn

from truestand.core.errors import UnreadableFile

MOST_DIGITS = 300
"""Of a whole number that float64 still holds."""


def parse_json(text: str, name: str, advice: str) -> Any:
    """What a JSON text holds.

    Raises:
        UnreadableFile: no JSON, or a number that isn't finite; ``name`` and ``advice`` stand in the message.
    """
    try:
        return json.loads(text, parse_float=_finite, parse_int=_whole, parse_constant=_refuse)
    except _NoNumber as wrong:
        found = str(wrong)
        place = re.search(rf"[:,\[]\s*{re.escape(found)}(?=\s*[,\]}}])", text)
        line = text.count("\n", 0, place.end() if place else 0) + 1
        raise UnreadableFile(f"{name}: found {found[:40]} in line {line}, need finite numbers; {advice}") from wrong
    except (ValueError, RecursionError) as wrong:
        raise UnreadableFile(f"{name}: no JSON ({wrong})") from wrong


class _NoNumber(Exception):
    """What JSON's grammar or Python's parser lets pass as a number, and is none; the message is its text."""


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _refuse(text)


def _whole(text: str) -> int:
    return int(text) if len(text) <= MOST_DIGITS else _refuse(text)


def _refuse(text: str) -> NoReturn:
    raise _NoNumber(text)
