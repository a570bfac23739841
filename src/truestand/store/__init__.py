"""Results kept as evidence: append-only, each with what it rests on, and checked by ``audit`` down to the last bit."""

from truestand.store.audit import Finding, Report
from truestand.store.entry import Entry
from truestand.store.store import Standing, Store

__all__ = ["Entry", "Finding", "Report", "Standing", "Store"]
