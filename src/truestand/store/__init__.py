"""Results kept as evidence: append-only, each with its evidence; ``audit`` checks every byte."""

from truestand.store.audit import Finding, Report
from truestand.store.entry import Entry
from truestand.store.standing import Results
from truestand.store.store import Result, Store

__all__ = ["Entry", "Finding", "Report", "Result", "Results", "Store"]
