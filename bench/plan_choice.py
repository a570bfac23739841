"""Is a plan's choice as good as the best of many places? Places at random, all that show as much looked at.

    python bench/plan_choice.py spur --places 2000

Printed: the worst U over its limits of the plan's single view, and of the best of the places.
"""

import argparse
import time
from math import pi, radians

import numpy as np

from plan_stands import PARTS, planned
from truestand.core.errors import NotEnoughData
from truestand.planning.place import Place
from truestand.planning.search import AS_GOOD
from truestand.planning.target import Mount, share_of_room
from truestand.planning.views import shaft_in_view, shows_shaft, uncalibrated, views_at

ASSESSED = 25
"""Of the places that roughly are the best."""


def worst(target, views) -> float:
    return max(share_of_room(line) or 0.0 for line in target.lines(views))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--places", type=int, default=2000)
    options = parser.parse_args()
    start = time.process_time()
    found = planned(options.part, 1)
    print(f"{options.part}: plan in {time.process_time() - start:.0f} s of CPU")
    search, (view,) = found.search, found.views
    setting, target, sensor = search.setting, search.target, view.mount.sensor
    missing = search.missing(search.seen_from(view.mount))
    rng, heights = np.random.default_rng(0), target.surfaces.points[:, 2]
    known = []
    for _ in range(options.places):
        place = Place(
            -float(rng.uniform(radians(30.0), pi - radians(30.0))), float(rng.uniform(*sensor.optics.range)),
            float(rng.uniform(heights.min() - 15, heights.max() + 15)),
            float(rng.uniform(-0.3, 0.3) * setting.thinnest),
        )  # fmt: skip
        mount = Mount(sensor, place, 0.0)
        if (
            search.gap(mount) < search.room.least_clearance
            or search.missing(search.seen_from(mount)) > missing + AS_GOOD
        ):
            continue
        if not shows_shaft(shaft_in_view(uncalibrated(place, setting), sensor.optics, setting.shaft), setting.shaft):
            continue
        try:
            views = views_at([mount], setting, target)
        except NotEnoughData:
            continue
        known.append((max(target.rough_shares(views).values()), views))
    known.sort(key=lambda pair: pair[0])
    print(f"{len(known)} of {options.places} places show as much and can be calibrated")
    own = worst(target, found.views)
    best = min(worst(target, views) for _, views in known[:ASSESSED])
    print(f"worst U of the limits: plan {own:.3f}, best of {ASSESSED} of them {best:.3f}; plan / best {own / best:.3f}")


if __name__ == "__main__":
    main()
