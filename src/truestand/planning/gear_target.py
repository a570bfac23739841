"""A gear for which sensors are placed: what must be seen of its flanks, and how they would be inspected.

The cells of its flanks are filled as scans on several stands would fill them: what the budget leaves open of a stand is
drawn, and noise. They are then assessed as those of an inspection are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, product
from math import ceil, cos, sin

import numpy as np

from truestand.apply.datum import datum_of
from truestand.core.arrays import Array, Ints, Mask
from truestand.core.assumptions import PLANE_TILT_U, K
from truestand.core.calibration import Calibration
from truestand.core.errors import BadRecipe
from truestand.core.inspection import Characteristic
from truestand.gear.assess import Assessment, assess
from truestand.gear.budget import Weighed, influences_of, radial_lines
from truestand.gear.characteristics import characteristics_of, limits_of
from truestand.gear.coverage import coverage_of
from truestand.gear.damage import unseen_in_traces
from truestand.gear.drawing import Gear
from truestand.gear.evaluate import evaluate, evaluator_of, slope_length
from truestand.gear.flanks import Toothing
from truestand.gear.geometry import FLANKS, SIGMA, Involute, involute
from truestand.gear.grid import HEIGHT_CELL, SPACINGS, Grid, centres_of, height_edges, step_on_flank
from truestand.gear.seams import corrected, difference_of
from truestand.gear.seen_flanks import Influence, SeenFlanks, seen_flanks
from truestand.gear.teeth import Diameter
from truestand.planning.obstacles import Body, Round, Toothed
from truestand.planning.optics import Optics
from truestand.planning.place import Place
from truestand.planning.sight import Sight, centred, look
from truestand.planning.target import Surfaces, View, room_of

ROLLS, HEIGHTS = 9, 9
"""Points of a flank along roll length and height that must be seen."""
FEW, SHOWS = 5, 0.5
"""Points along profile and face that tell roughly how large U is; share of them from which a flank is shown."""
LEAST_OVERLAP, SEAM_U = 0.05, 5e-4
"""Share of the flanks that two views must both show to be held against each other; mm, standard: of noise in it."""
FINE = 48
"""Points along roll length and height of a picture of a flank."""
USUAL_SHARE, USUAL_PITCH, USUAL_FORM = 0.35, 0.004, 0.003
"""Of a gear that is looked at, share of its limits: standard deviation of its pitch; slopes and form, from crest to
crest, of its flanks; mm where it has none.
"""
USUAL_WAVES, USUAL_FEED = 2.0, 2.0
"""Of this form, waves along the profile; mm of height from one mark that a hob's feed left on the face to the next."""
PARTS, ASIDE = 4, (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Of a cell's height, for each of which it is told which profiles meet it: on helical flanks they pass aslant. Of the
eccentricity, ways aside for which it is told what is seen of a tooth.
"""
USUAL_CLASS = 7
"""By which U is weighed where the drawing limits nothing."""
FORMS = (0.2, 0.7, 1.4)
"""Of this form, what the gears of the imagined scans have: how large U is depends on what a scan reads, and U of form
is largest where there is least of it (the middles of thirds of a half-normal distribution).
"""
GEARS = 16
"""Of an imagined scan, that have other pitch each."""
LARGEST_OF_TEETH = 0.7
"""Of a wave's height over a turn: by so much it moves the range of a gear's pitch on average."""


@dataclass(frozen=True)
class GearTarget:
    """A gear on a shaft."""

    gear: Gear
    shaft: tuple[Round, ...]
    turns: float
    """Of a scan."""
    profiles_per_turn: float
    toothing: Toothing
    """As drawn."""
    _roughly: dict[tuple[Place, Optics, bool], SeenFlanks] = field(default_factory=dict, repr=False, compare=False)
    """What ``rough_shares`` has found of places, of sensors carried there or not: most are compared many times."""

    @cached_property
    def surfaces(self) -> Surfaces:
        """The evaluation ranges of a tooth's flanks."""
        nominal = self.toothing.nominal
        rolls, heights = (
            np.linspace(*r, n) for r, n in ((nominal.profile_range, ROLLS), (nominal.helix_range, HEIGHTS))
        )
        side, i, j = np.indices((2, ROLLS, HEIGHTS)).reshape(3, -1)
        points, normals = _flank_points(self.toothing, side, rolls[i], heights[j])
        return Surfaces(FLANKS, points, normals, side)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The gear."""
        return (Toothed(self.toothing.nominal, self.toothing.datum.pose, self.toothing.first_tooth),)

    @property
    def swept(self) -> tuple[Round, ...]:
        """Its tip cylinder."""
        return (Round(self.gear.tip_diameter / 2, self.gear.face_from, self.gear.face_to),)

    def lines(self, views: Sequence[View]) -> tuple[Characteristic, ...]:
        """The lines that an inspection by these views would have."""
        self._roughly.clear()  # the search for them is over
        cells = self._cells(views)
        readings = [self._readings(view, cells) for view in views]
        seen = [np.broadcast_to(r.number > 0, self._shape(cells)) for r in readings]
        grid, rng, scans = self._grid(cells, readings), np.random.default_rng(0), []
        own = [seen_flanks(v.scan, v.calibration, self.toothing, grid.roll, grid.height) for v in views]
        calibrations = _tied(views, own, seen)
        for form in FORMS:
            read = self._read(grid, views, readings, rng)
            influences = influences_of(_sources(calibrations, own, read.shares), grid, self.toothing)
            pitches = np.stack([_usual_pitch(self.gear, rng) for _ in range(GEARS)])
            scanned = self._scanned(grid, influences, read, pitches[0], form, rng)
            otherwise = SIGMA[:, None] * (pitches - pitches[0])[..., 0, 0] * grid.nominal.arc_per_delta
            scans.append(self._lines_of(scanned, influences, otherwise))
        return tuple(_typical(of) for of in zip(*scans, strict=True))

    def _lines_of(self, grid: Grid, influences: tuple[Influence, ...], otherwise: Array) -> tuple[Characteristic, ...]:
        """The lines that an inspection would have, were these its cells; of the pitch, those of gears whose teeth stand
        ``otherwise`` by (gears, 2, teeth) mm, too.
        """
        step, teeth = 2 * np.pi / self.profiles_per_turn, self.gear.teeth
        evaluator = evaluator_of(grid, step)
        measures = evaluate(grid.delta, evaluator)
        coverage = coverage_of(evaluator, measures, step, np.zeros((2, teeth)), np.zeros(2, dtype=bool))
        there = ~np.isin(np.arange(teeth) + 1, self.gear.missing_teeth)
        gaps = unseen_in_traces(grid, evaluator.traces, step)
        found = assess(influences, evaluator, step, measures, coverage, (), gaps, there, otherwise)
        return characteristics_of(found, _diameters(found, self.gear))

    def picture(self, view: View) -> "FlankPicture":
        """What a view sees of a tooth's flanks, finely."""
        nominal = self.toothing.nominal
        low, high = nominal.profile_range
        edges = np.linspace(*nominal.helix_range, FINE + 1)
        cells = _Cells(centres_of(low, high, FINE), edges)
        sight = self._sight(view, cells)
        return FlankPicture(
            (low, high), nominal.helix_range, np.where(sight.seen, np.arccos(sight.facing), np.nan).reshape(cells.shape)
        )

    def rough_shares(self, views: Sequence[View]) -> dict[str, float]:
        """As ``Target`` says, by a few points of each flank, without noise."""
        nominal = self.toothing.nominal
        (low, high), (bottom, top) = nominal.profile_range, nominal.helix_range
        cells = _Cells(np.linspace(low, high, FEW), np.linspace(bottom, top, FEW + 1))
        empty = np.zeros((2, self.gear.teeth, FEW, FEW))
        seen = [(empty + self._sight(view, cells).seen.reshape(2, 1, FEW, FEW)) > 0 for view in views]
        number = np.sum(seen, axis=0)
        shares = [np.where(number > 0, s / np.maximum(number, 1), 1 / len(views)) for s in seen]
        roll, height = empty + cells.rolls[:, None], empty + cells.heights
        grid = Grid(nominal, empty, empty, roll, height, empty, cells.rolls, cells.edges, 0.0)
        own = [self._roughly_seen(view, grid) for view in views]
        influences = influences_of(_sources(_tied(views, own, seen), own, shares), grid, self.toothing)
        moved = _moved(np.stack([i.field for i in influences]), nominal, cells)
        worst = np.zeros(2)
        for name, by in moved.items():
            if (room := self._room(name)) is not None:
                worst = np.maximum(worst, np.sqrt(np.square(by).sum(axis=0)) / room)
        return {name: float(worst[k]) for k, name in enumerate(FLANKS) if (number[k] > 0).mean() > SHOWS}

    def _roughly_seen(self, view: View, grid: Grid) -> SeenFlanks:
        """The flanks as a view sees them in the few cells of ``rough_shares``."""
        sensor = view.mount.sensor
        key = view.mount.place, sensor.optics, sensor.carried
        if key not in self._roughly:
            self._roughly[key] = seen_flanks(view.scan, view.calibration, self.toothing, grid.roll, grid.height)
        return self._roughly[key]

    def _room(self, name: str) -> float | None:
        """mm that the limits of a figure leave, those of a class where the drawing has none at all; None: no limit."""
        g = self.gear
        if g.accuracy_class is None and not g.limits and not g.classes:
            g = replace(g, accuracy_class=USUAL_CLASS)
        try:
            limits, _ = limits_of(g, name)
        except BadRecipe:  # a gear for which the standard has no classes
            return None
        return room_of(limits, from_zero=True)

    def _cells(self, views: Sequence[View]) -> "_Cells":
        """Cells as an inspection has them."""
        nominal = self.toothing.nominal
        spacing = max(_spacing_at_middle(view) for view in views)
        number = int(np.ceil(nominal.control_length / self.gear.evaluation.resolution))
        edges = height_edges(nominal, max(HEIGHT_CELL, SPACINGS * spacing))
        return _Cells(centres_of(nominal.control_roll, nominal.tip_roll, number), edges)

    def _shape(self, cells: "_Cells") -> tuple[int, ...]:
        """(2, teeth, R, H)."""
        return 2, self.gear.teeth, cells.rolls.size, cells.edges.size - 1

    def _readings(self, view: View, cells: "_Cells") -> "_Readings":
        """What a profile of a view would have in each cell, of the teeth as their shaft runs out."""
        nominal, shape, sight = self.toothing.nominal, cells.shape, self._sight(view, cells)
        apart = _heights_apart(sight.z.reshape(shape), cells.heights, view)
        run_out = view.calibration.eccentricity
        seen = np.array([self._sight(view, cells, way * run_out).seen.reshape(shape) for way in ASIDE])
        aside = np.sin(self.gear.pitch * np.arange(self.gear.teeth))
        nearest = np.abs(aside[:, None] - ASIDE).argmin(axis=1)
        number = np.where(seen[nearest].swapaxes(0, 1), np.diff(cells.edges) / apart[:, None], 0.0)
        u = view.mount.sensor.optics.noise * np.abs(sight.facing.reshape(shape)) / nominal.normal_per_delta
        return _Readings(number, u[:, None])

    def _scanned(
        self, grid: Grid, influences: Sequence[Influence], read: "_Read", pitch: Array, form: float,
        rng: np.random.Generator,
    ) -> Grid:  # fmt: skip
        """The cells of a gear with ``pitch`` errors, and so much of the usual ``form``, as a stand would read them of
        which each input errs by its standard uncertainty, one way or the other: few scans stand for many stands.
        """
        delta = np.where(read.count > 0, _usual_flanks(grid.nominal, read.roll, grid.heights, form), np.nan)
        delta += pitch + read.u * rng.standard_normal(delta.shape)
        for influence in influences:
            delta += rng.choice((-1.0, 1.0)) / K * influence.field
        return replace(grid, delta=delta, median=delta, roll=read.roll, count=read.count)

    def _read(
        self, grid: Grid, views: Sequence[View], readings: Sequence["_Readings"], rng: np.random.Generator
    ) -> "_Read":
        """The readings of all views, of which any share of a step of the table lies between the middle of the first
        tooth and a profile, and whose laser planes are mounted along the axis as well as usual.
        """
        count, share = np.zeros((2, len(views), *grid.delta.shape))
        first, radius = float(rng.random()), grid.nominal.measuring_radius
        for k, (view, r) in enumerate(zip(views, readings, strict=True)):
            azimuth, aside = view.mount.place.azimuth, view.calibration.eccentricity / radius
            skew = float(rng.normal(0.0, PLANE_TILT_U / K)) / radius
            for part, number in enumerate(_in_parts(r.number, float(rng.random()))):
                heights = grid.heights + ((part + 0.5) / PARTS - 0.5) * grid.size[1]
                met, at = profiles_met(grid, heights, self.turns, self.profiles_per_turn, first, azimuth, aside, skew)
                count[k] += number * met
                share[k] += number * met * at
        total = count.sum(axis=0)
        one = np.maximum(total, 1.0)
        up = np.where(total > 0, share.sum(axis=0) / one, 0.5)
        variance = np.stack([np.broadcast_to(np.square(r.u), total.shape) for r in readings])
        u = np.sqrt(np.sum(count * variance, axis=0)) / one
        shares = tuple(np.where(total > 0, of / one, 1 / len(views)) for of in count)
        return _Read(shares, total, grid.roll + (up - 0.5) * grid.size[0], u)

    def _sight(self, view: View, cells: "_Cells", aside: float = 0.0) -> Sight:
        """What a view sees of the cells (2 R H,) of a tooth that passes ``aside`` (mm) of where one of a shaft that
        runs true would.
        """
        side, i, j = np.indices(cells.shape).reshape(3, -1)
        points, normals = _flank_points(self.toothing, side, cells.rolls[i], cells.heights[j])
        bodies = (*self.bodies, *self.shaft)
        return look(points, normals, centred(view.calibration, aside), view.mount.sensor.optics, bodies)

    def _grid(self, cells: "_Cells", readings: Sequence["_Readings"]) -> Grid:
        """All cells that views show, of a gear with usual slopes and form; nothing errs in reading it."""
        nominal, shape = self.toothing.nominal, self._shape(cells)
        number = np.broadcast_to(np.sum([r.number for r in readings], axis=0), shape)
        delta = np.where(number > 0, _usual_flanks(nominal, cells.rolls[:, None], cells.heights), np.nan)
        roll, height = np.broadcast_to(cells.rolls[:, None], shape), np.broadcast_to(cells.heights, shape)
        scatter = float(np.median([np.median(r.u) for r in readings]))
        return Grid(nominal, delta, delta, roll, height, number, cells.rolls, cells.edges, scatter)


@dataclass(frozen=True, slots=True)
class FlankPicture:
    """How steeply a tooth's flanks are seen."""

    rolls: tuple[float, float]
    """mm of roll length, from and to."""
    heights: tuple[float, float]
    """mm in C, from and to."""
    incidence: Array
    """(2, roll lengths, heights) rad; NaN: not seen."""


@dataclass(frozen=True, slots=True)
class _Cells:
    """How the flanks are cut into cells."""

    rolls: Array
    """(R,) mm, centres."""
    edges: Array
    """(H + 1,) mm in C."""

    @property
    def heights(self) -> Array:
        """(H,) mm, centres."""
        return np.asarray((self.edges[:-1] + self.edges[1:]) / 2)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the cells of a tooth: (2, R, H)."""
        return 2, self.rolls.size, self.edges.size - 1


@dataclass(frozen=True, slots=True)
class _Readings:
    """What a profile of a view has in the cells, were it to meet them."""

    number: Array
    """(2, teeth, R, H)."""
    u: Array
    """(2, 1, R, H) mm of delta: standard deviation of a reading."""


@dataclass(frozen=True, slots=True)
class _Read:
    """What a scan has in the cells (2, teeth, R, H)."""

    shares: tuple[Array, ...]
    """Of its readings, by view."""
    count: Array
    roll: Array
    """mm: mean of the readings."""
    u: Array
    """mm of delta: standard deviation of their mean."""


def gear_target(
    gear: Gear, calibration: Calibration, shaft: tuple[Round, ...], turns: float, profiles_per_turn: float
) -> GearTarget:
    """A gear as drawn on the datum of the shaft that a calibration knows."""
    nominal, datum = involute(gear), datum_of(calibration, gear.datum, gear.bore_clearance)
    toothing = Toothing(nominal, datum, 0.0, np.zeros(2 * gear.teeth), 1.0)
    return GearTarget(gear, shaft, turns, profiles_per_turn, toothing)


def _in_parts(number: Array, first: float) -> Array:
    """Readings (``PARTS``, 2, teeth, R, H) that a profile has in each part of the cells, of a ``number`` (2, teeth, R,
    H) in the whole; ``first``: share 0..1 of one by which the lowest misses the end of the face.
    """
    before = np.cumsum(number, axis=3) - number
    ends = [np.floor(first + before + number * part / PARTS) for part in range(PARTS + 1)]
    return np.diff(ends, axis=0)


def profiles_met(
    grid: Grid, heights: Array, turns: float, per_turn: float, first: float, azimuth: float, aside: float = 0.0,
    skew: float = 0.0,
) -> tuple[Array, Array]:  # fmt: skip
    """How many profiles (2, teeth, R, H) of a scan of so many ``turns`` meet each cell at ``heights`` (H,) mm, and at
    what share 0..1 of its roll length: a further turn brings others only where a turn is no whole number of profiles.

    ``first``: share 0..1 of a step of the table by which a profile misses the middle of the first tooth; ``azimuth`` of
    the sensor, rad; ``aside``, by which an eccentric gear's teeth come sooner or later than they stand on it (rad), and
    ``skew``, by which a skew laser plane meets them so along the face (rad per mm).
    """
    nominal, gear, step = grid.nominal, grid.nominal.gear, 2 * np.pi / per_turn
    size, _ = grid.size
    up_the_flank = np.concatenate([[0.0], np.cumsum(size / step_on_flank(nominal, grid.rolls, step))])
    side, tooth = np.indices((2, gear.teeth))[..., None, None]
    angle = (tooth + side / 2) * gear.pitch + heights * nominal.twist + azimuth
    angle = angle + aside * np.sin(angle) + skew * (heights - nominal.middle)
    at_edges = first + angle / step - SIGMA[side] * up_the_flank[:, None]
    low, high = (of(at_edges[:, :, :-1], at_edges[:, :, 1:]) for of in (np.minimum, np.maximum))
    count, share = np.zeros((2, *low.shape))
    for turn in range(-1, ceil(turns) + 1):
        before, last = (np.floor(np.clip(at + turn * per_turn, 0.0, turns * per_turn)) for at in (low, high))
        count += last - before
        share += (last - before) * ((before + 1 + last) / 2 - turn * per_turn - low) / (high - low)
    share = share / np.maximum(count, 1.0)
    return count, np.where(SIGMA[side] > 0, 1.0 - share, share)


def _sources(
    calibrations: Sequence[Calibration], own: Sequence[SeenFlanks], shares: Sequence[Array]
) -> tuple[Weighed, ...]:
    """The views with their ``shares`` (2, teeth, R, H) of each cell."""
    alone = len(own) == 1
    return tuple(
        Weighed(seen, calibration, None if alone else share)
        for seen, calibration, share in zip(own, calibrations, shares, strict=True)
    )


def _tied(views: Sequence[View], own: Sequence[SeenFlanks], seen: Sequence[Mask]) -> list[Calibration]:
    """The views' calibrations with what their overlaps tell of where they stand; ``seen`` (2, teeth, R, H): by each."""
    calibrations, found = [view.calibration for view in views], []
    for (a, b), side in product(combinations(range(len(views)), 2), (0, 1)):
        both = np.zeros_like(seen[a])
        both[side] = seen[a][side] & seen[b][side]
        if both.mean() > LEAST_OVERLAP:
            found.append(difference_of(own, (a, b), side, 0.0, SEAM_U, both))
    return corrected(calibrations, found) if found else calibrations


def _typical(lines: Sequence[Characteristic]) -> Characteristic:
    """The line of several scans that has the middle U: one of them may be read badly by chance."""
    return sorted(lines, key=lambda line: np.inf if line.U is None else line.U)[len(lines) // 2]


def _moved(fields: Array, nominal: Involute, cells: "_Cells") -> dict[str, Array]:
    """By how much (inputs, 2) each figure moves with ``fields`` (inputs, 2, teeth, R, H) mm of delta."""
    middle, rolls, heights = FEW // 2, np.ptp(cells.rolls), np.ptp(cells.heights)
    profile, helix = fields[..., middle], fields[..., middle, :]
    place = fields[..., middle, middle] * nominal.arc_per_delta
    along_profile, along_helix = (np.abs(f[..., -1] - f[..., 0]).max(axis=2) for f in (profile, helix))
    return {
        "f_Halpha": along_profile * slope_length(nominal, along_profile=True) / rolls,
        "F_alpha": np.ptp(profile, axis=3).max(axis=2),
        "f_falpha": np.ptp(_bent(profile), axis=3).max(axis=2),
        "f_Hbeta": along_helix * slope_length(nominal, along_profile=False) / heights,
        "F_beta": along_helix,
        "f_fbeta": np.ptp(_bent(helix), axis=3).max(axis=2),
        "F_p": LARGEST_OF_TEETH * np.ptp(place, axis=2),
        "f_p": np.abs(np.diff(place, axis=2)).max(axis=2),
    }


def _bent(traces: Array) -> Array:
    """Traces (..., n) less their straight lines."""
    at = np.linspace(-1.0, 1.0, traces.shape[-1])
    slope = traces @ at / (at @ at)
    return np.asarray(traces - traces.mean(axis=-1, keepdims=True) - slope[..., None] * at)


def _flank_points(toothing: Toothing, side: Ints, roll: Array, height: Array) -> tuple[Array, Array]:
    """Points (n, 3) mm in C of the flanks of the first tooth, and their normals (n, 3)."""
    points = toothing.points((side, np.zeros_like(side)), roll, height, np.zeros(roll.size))
    return points, toothing.gradient(points, SIGMA[side])


def _spacing_at_middle(view: View) -> float:
    """mm of height between neighbouring points at the middle of the range."""
    optics = view.mount.sensor.optics
    return float(optics.spacing(optics.middle)) / max(abs(sin(view.calibration.phi)), 0.1)


def _heights_apart(z: Array, heights: Array, view: View) -> Array:
    """mm of height from one point of a profile to the next, at ranges z (2, R, H)."""
    along_x, along_z = sin(view.calibration.phi), cos(view.calibration.phi)
    v = heights - float(view.calibration.table_from_sensor.translation[2])
    x = (v - along_z * z) / (along_x or 1e-9)
    return np.asarray(view.mount.sensor.optics.spacing(z) / np.maximum(np.abs(along_x - x / z * along_z), 1e-3))


def _usual_pitch(gear: Gear, rng: np.random.Generator) -> Array:
    """mm of delta (2, teeth, 1, 1): where the flanks of a gear stand that is as good as its class asks."""
    run_out = np.cos(gear.pitch * np.arange(gear.teeth) + np.array([[0.0], [2.0]]))
    size = _usual(gear, "f_p", USUAL_PITCH)
    return np.asarray(size * (rng.standard_normal((2, gear.teeth)) + run_out)[..., None, None])


def _usual_flanks(nominal: Involute, rolls: Array, heights: Array, form: float = 1.0) -> Array:
    """mm of delta (..., R, H) at roll lengths (..., R, 1 or H) and ``heights`` (H,): slopes of all flanks of such a
    gear, and so much of its ``form``.
    """
    gear = nominal.gear

    def trace(of: str, at: Array, within: tuple[float, float], phase: Array) -> Array:
        share = (at - within[0]) / (within[1] - within[0])
        slope, crests = (_usual(gear, name + of, USUAL_FORM) for name in ("f_H", "f_f"))
        return np.asarray(slope * (share - 0.5) + form * crests / 2 * np.sin(phase))

    (low, high), turn = nominal.profile_range, 2 * np.pi
    along_profile = trace("alpha", rolls, (low, high), turn * USUAL_WAVES * (rolls - low) / (high - low))
    along_face = trace("beta", heights, nominal.helix_range, turn * heights / USUAL_FEED)
    return np.asarray((along_profile + along_face) / nominal.normal_per_delta)


def _usual(gear: Gear, name: str, otherwise: float) -> float:
    """mm: the usual share of a figure's limit, ``otherwise`` where it has none."""
    try:
        limits, _ = limits_of(gear, name)
    except BadRecipe:  # a gear for which the standard has no classes
        return otherwise
    return otherwise if limits is None or limits[1] is None else USUAL_SHARE * limits[1]


def _diameters(found: Assessment, gear: Gear) -> tuple[Diameter, ...]:
    lines = radial_lines(found.influences)
    U = float(np.sqrt(sum(line.U**2 for line in lines)))
    seen = float(found.coverage.position.max(axis=0).mean())
    named = (("d_a", gear.tip_diameter), ("d_f", gear.root_diameter))
    return tuple(Diameter(name, value, U, seen, lines) for name, value in named)
