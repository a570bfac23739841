"""Variants of what the default run tries once: ``.ci/run`` runs them after it."""

from collections.abc import Iterable
from typing import Any

import pytest


def tried(first: Iterable[Any], *more: Any, rarely: Iterable[Any] = ()) -> list[Any]:
    """Parameters, tuples where there are several names, of which only the ``first`` ones are run by default, and those
    that are tried ``rarely`` only among the slow ones.
    """
    return [*first, *_marked(more, pytest.mark.more), *_marked(rarely, pytest.mark.slow)]


def _marked(values: Iterable[Any], mark: pytest.MarkDecorator) -> list[Any]:
    return [pytest.param(*(v if isinstance(v, tuple) else (v,)), marks=mark) for v in values]
