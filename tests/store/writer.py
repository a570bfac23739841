"""A process that stores results until it is killed; it prints the number of each once the store has acknowledged it."""

import sys
from pathlib import Path

from truestand.store import Store

folder, scan, name, count = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], int(sys.argv[4])
store = Store.open(folder, create=True)
for k in range(count):
    scan_k = scan.with_name(f"{name}-{k}.csv")
    scan_k.write_text(scan.read_text() + f"{name} {k}\n")
    entry = store.add("calibration", {"by": name, "k": k, "x": [0.1] * 500}, {"scan": scan_k}, operator=name)
    print(entry.number, entry.hash, flush=True)
