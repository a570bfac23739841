"""Variants of what the default run tries once: ``.ci/run`` runs them after it."""

from collections.abc import Iterable
from typing import Any

import pytest


def tried(first: Iterable[Any], *more: Any) -> list[Any]:
    """Parameters, tuples where there are several names, of which only the ``first`` ones are run by default."""
    return [*first, *(pytest.param(*(m if isinstance(m, tuple) else (m,)), marks=pytest.mark.more) for m in more)]
