"""Associated features and form against reference data and generated pairs whose optimum is known."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truestand.core.errors import BadRecipe, NotEnoughData
from truestand.files.shapes.points import read_points
from truestand.form.associate import associate
from truestand.form.form import evaluate
from truestand.form.upr import UprFilter, upr_filter
from variants import tried

DATA = Path(__file__).parents[1] / "data"
DESICOS = Path(__file__).parents[3] / "shared" / "data" / "desicos"
MM, RAD = 1e-6, 1e-8
"""Promised agreement with reference features (docs/validation.md)."""


def placed(points, seed):
    """The points turned and moved by 1e5 mm, with the rotation and the shift."""
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    shift = rng.uniform(-1e5, 1e5, 3)
    return points @ turn.T + shift, turn, shift


def balanced(jacobian, size, seed):
    """Residuals (n,) that no small change of the feature can better: orthogonal to its Jacobian."""
    basis, _ = np.linalg.qr(jacobian)
    e = np.random.default_rng(seed).normal(0, size, len(jacobian))
    for _ in range(2):
        e = e - basis @ (basis.T @ e)
    return e


@pytest.mark.parametrize("file", sorted(DATA.glob("nist_circles/*.ds")), ids=lambda f: f.stem)
def test_nist_circles(file):
    reference = np.array(file.with_suffix(".fit").read_text().split(), dtype=float)
    found = evaluate(read_points(file).points, "circle")
    assert np.abs(found.point - reference[:3]).max() < MM
    assert np.linalg.norm(np.cross(found.direction, reference[3:6])) < RAD
    assert abs(2 * found.radius - reference[6]) < MM


@pytest.mark.parametrize("name", ["efre_2014_r07_laser_msi", "rtu_2014_r15_LASER_msi"])
def test_desicos_cylinders(name):
    if not DESICOS.is_dir():
        pytest.skip("needs the measured cylinders of desicos beside the project")
    points, published = np.loadtxt(DESICOS / f"{name}.txt"), np.loadtxt(DESICOS / f"{name}_theta_z_imp.txt")
    assert np.abs(evaluate(points, "cylinder").deviation - published[:, 2]).max() < 1e-5


def test_the_desicos_sample_is_published_with_an_axis_3_urad_off_the_optimum():
    """The sample's deviations agree to 1e-6 mm once a rigid move of the axis is allowed; ours have the smaller rms."""
    if not DESICOS.is_dir():
        pytest.skip("needs the measured cylinders of desicos beside the project")
    points, published = (np.loadtxt(DESICOS / f"tutorial_sample{n}.txt") for n in ("", "_theta_z_imp"))
    found = evaluate(points, "cylinder")
    assert found.radius == pytest.approx(407.193, abs=5e-4)
    along = -(points - found.point) @ found.direction
    offset = published[0, 1] - along[0]
    rows, at = [], 0
    for i, height in enumerate(along):  # the same order, 39 left out near the ends
        if at < len(published) and abs(height + offset - published[at, 1]) < 0.01:
            rows.append(i)
            at += 1
    assert len(rows) == 961
    theta, z = published[:, 0], published[:, 1] - published[:, 1].mean()
    move = np.column_stack([np.ones(961), np.cos(theta), np.sin(theta), z * np.cos(theta), z * np.sin(theta)])
    off = found.deviation[rows] - published[:, 2]
    rest = off - move @ np.linalg.lstsq(move, off, rcond=None)[0]
    assert np.abs(off).max() < 2.5e-3
    assert np.abs(rest).max() < 1e-6


@pytest.mark.parametrize("radius", [1.0, 100.0, 1e4])
@pytest.mark.parametrize("arc", [20, 45, 90, 180, 360])
def test_round_features_on_any_arc_far_from_the_origin(radius, arc):
    rng = np.random.default_rng(arc)
    size = 1e-4 * min(radius, 10)
    t = np.linspace(0, np.radians(arc), 200, endpoint=arc < 360)
    one = np.ones_like(t)
    c, s = np.cos(t), np.sin(t)
    r = radius + balanced(np.column_stack([c, s, one]), size, 1)
    points, turn, shift = placed(np.column_stack([r * c, r * s, 0 * t]), 2)
    circle = evaluate(points, "circle")
    assert np.abs(circle.point - shift).max() < MM
    assert abs(circle.radius - radius) < MM
    assert np.linalg.norm(np.cross(circle.direction, turn[:, 2])) < RAD
    h = rng.uniform(-1, 1, t.size)
    r = radius + balanced(np.column_stack([c, s, h * c, h * s, one]), size, 3)
    points, turn, shift = placed(np.column_stack([r * c, r * s, h * radius]), 4)
    cylinder = evaluate(points, "cylinder")
    beside = cylinder.point - shift
    assert np.linalg.norm(beside - beside @ turn[:, 2] * turn[:, 2]) < MM
    assert abs(cylinder.radius - radius) < MM
    assert np.linalg.norm(np.cross(cylinder.direction, turn[:, 2])) < RAD
    up = np.cos(np.radians(arc) / 2 * rng.random(t.size))
    u = np.column_stack([np.sqrt(1 - up**2) * c, np.sqrt(1 - up**2) * s, up])
    points = (radius + balanced(np.column_stack([u, one]), size, 5))[:, None] * u + shift
    sphere = evaluate(points, "sphere")
    # A cap of 10 degrees half opening holds the centre 130 times worse than the points; doubles at 1e5 mm end there.
    assert np.abs(sphere.point - shift).max() < (MM if arc > 20 else 1e-5)
    assert abs(sphere.radius - radius) < (MM if arc > 20 else 1e-5)


def test_line_and_plane():
    rng = np.random.default_rng(0)
    s, u = rng.uniform(-50, 50, (2, 300))
    one = np.ones_like(s)
    ex, ey = (balanced(np.column_stack([one, s]), 0.01, i) for i in (1, 2))
    points, turn, shift = placed(np.column_stack([ex, ey, s]), 3)
    line = evaluate(points, "line")
    assert np.linalg.norm(np.cross(line.direction, turn[:, 2])) < RAD * 2  # ex and ey together turn by 1e-8 at most
    assert line.form == pytest.approx(2 * np.hypot(ex, ey).max(), rel=1e-6)
    e = balanced(np.column_stack([one, s, u]), 0.01, 4)
    points, turn, shift = placed(np.column_stack([s, u, e]), 5)
    plane = evaluate(points, "plane")
    assert np.linalg.norm(np.cross(plane.direction, turn[:, 2])) < RAD
    assert abs((plane.point - shift) @ turn[:, 2]) < MM
    assert plane.form == pytest.approx(np.ptp(e), rel=1e-6)
    assert plane.direction[np.argmax(np.abs(plane.direction))] > 0


@pytest.mark.parametrize("half_angle", [-40, 3, 20, 60])
@pytest.mark.parametrize("arc", [90, 360])
def test_cones_on_any_arc_far_from_the_origin(arc, half_angle):
    rng = np.random.default_rng(arc)
    phi = np.radians(half_angle)
    t, s = np.radians(arc) * np.arange(300) / 300, rng.uniform(-8, 8, 300)
    c, z = np.cos(t), np.sin(t)
    one, over = np.ones_like(t), s / np.cos(phi)
    leaning = np.cos(phi) * s + np.sin(phi) * (20 + s * np.tan(phi))
    e = balanced(np.column_stack([c, z, leaning * c, leaning * z, one, over]), 1e-3, 7)
    radius, height = 20 + s * np.tan(phi) + e * np.cos(phi), s - e * np.sin(phi)
    points, turn, shift = placed(np.column_stack([radius * c, radius * z, height]), 8)
    cone = evaluate(points, "cone")
    sense = np.sign(cone.direction @ turn[:, 2])
    along = (cone.point - shift) @ turn[:, 2]
    # second orders of e aside, which move the optimum
    assert abs(cone.half_angle - sense * phi) < 1e-7
    assert abs(cone.radius - (20 + along * np.tan(phi))) < MM
    assert np.linalg.norm(np.cross(cone.direction, turn[:, 2])) < 1e-7
    assert cone.form == pytest.approx(np.ptp(e), rel=1e-3)


def rough_circle(n, seed, noise=0.01):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0, 2 * np.pi, n))
    r = 10 + rng.normal(0, noise, n)
    return np.column_stack([r * np.cos(t) + 3, r * np.sin(t) - 2, np.zeros(n)])


def smallest_circle(points):
    """Radius by trying every pair and triple."""
    p, best = points[:, :2], np.inf
    for some in [*combinations(range(len(p)), 2), *combinations(range(len(p)), 3)]:
        q = p[list(some)]
        if len(some) == 2:
            centre = q.mean(axis=0)
        else:
            centre = np.linalg.solve(2 * (q[1:] - q[0]), (q[1:] ** 2).sum(axis=1) - (q[0] ** 2).sum())
        best = min(best, np.linalg.norm(p - centre, axis=1).max())
    return best


def narrowest_ring(points):
    """Width by trying every pair of outer and pair of inner contacts (the 2-2 condition of minimum zones)."""
    p, best = points[:, :2], np.inf
    for (a, b), (c, d) in combinations(list(combinations(range(len(p)), 2)), 2):
        sides = np.array([p[b] - p[a], p[d] - p[c]])
        if abs(np.linalg.det(sides)) < 1e-9:
            continue
        right = [(p[b] ** 2 - p[a] ** 2).sum() / 2, (p[d] ** 2 - p[c] ** 2).sum() / 2]
        r = np.linalg.norm(p - np.linalg.solve(sides, right), axis=1)
        best = min(best, np.ptp(r))
    return best


@pytest.mark.parametrize("seed", range(4))
def test_zones_against_trying_everything(seed):
    points = rough_circle(14, seed)
    circumscribed, zone = evaluate(points, "circle", "MCC"), evaluate(points, "circle", "MZC")
    assert circumscribed.radius == pytest.approx(smallest_circle(points), abs=1e-9)
    assert circumscribed.certificate.scope == "global"
    assert zone.form == pytest.approx(narrowest_ring(points), abs=1e-9)


@pytest.mark.more
@settings(deadline=None, max_examples=30)
@given(st.integers(5, 60), st.integers(0, 10**6), st.floats(1e-5, 0.1))
def test_zones_are_balanced_and_in_order(n, seed, noise):
    rng = np.random.default_rng(seed)
    t = 2 * np.pi * (np.arange(n) + rng.uniform(0, 0.4, n)) / n
    r = 10 + rng.normal(0, noise, n)
    points = np.column_stack([r * np.cos(t), r * np.sin(t), np.zeros(n)])
    least, zone, outer, inner = (evaluate(points, "circle", ref) for ref in ("LSC", "MZC", "MCC", "MIC"))
    for found in (zone, outer, inner):
        assert found.certificate.imbalance < 1e-9
        assert min(found.certificate.forces) > 0
        assert zone.form <= found.form + 1e-12
    assert zone.form <= least.form + 1e-12
    assert inner.radius <= zone.radius <= outer.radius
    assert outer.deviation.max() < 1e-12
    assert inner.deviation.min() > -1e-12


def flatness(points):
    """Width by trying every plane through three points, and those along two pairs: one of them bounds the zone."""
    best = np.inf
    for a, b, c in combinations(points, 3):
        normal = np.cross(b - a, c - a)
        best = min(best, np.ptp(points @ normal / np.linalg.norm(normal)))
    for (a, b), (c, d) in combinations(list(combinations(points, 2)), 2):
        normal = np.cross(b - a, d - c)
        if np.linalg.norm(normal) > 1e-9:
            best = min(best, np.ptp(points @ normal / np.linalg.norm(normal)))
    return best


@pytest.mark.parametrize("seed", range(3))
def test_flatness_and_straightness_against_trying_everything(seed):
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-10, 10, (10, 2)), rng.normal(0, 0.02, 10)])
    found = evaluate(placed(points, seed)[0] if seed == 2 else points, "plane", "MZC")
    assert found.form == pytest.approx(flatness(points), abs=1e-9)
    profile = np.column_stack([rng.normal(0, 0.02, 10), np.zeros(10), rng.uniform(-10, 10, 10)])
    widths = [np.ptp(profile[:, ::2] @ [b[2] - a[2], a[0] - b[0]]) / np.hypot(b[2] - a[2], a[0] - b[0])
              for a, b in combinations(profile, 2)]  # fmt: skip
    assert evaluate(profile, "line", "MZC").form == pytest.approx(min(widths), abs=1e-9)


@pytest.mark.parametrize(
    ("feature", "reference"),
    [("line", "MZC"), ("sphere", "MZC"), ("sphere", "MCC"), ("sphere", "MIC"), ("plane", "MZC"), ("cone", "MZC")],
)
def test_no_small_move_betters_a_zone(feature, reference):
    rng = np.random.default_rng(3)
    t, h, e = rng.uniform(0, 2 * np.pi, 200), rng.uniform(-20, 20, 200), rng.normal(0, 0.01, (3, 200))
    ball = rng.normal(size=(200, 3))
    points = {
        "line": np.column_stack([e[0], e[1], h]),
        "plane": np.column_stack([h, 10 * np.cos(t), e[0]]),
        "sphere": (15 + e[0])[:, None] * ball / np.linalg.norm(ball, axis=1)[:, None],
        "cone": np.column_stack([(30 + h / 2 + e[0]) * np.cos(t), (30 + h / 2 + e[0]) * np.sin(t), h]),
    }[feature]
    found = evaluate(points, feature, reference)
    assert found.certificate.imbalance < 1e-9

    def width(point, direction, angle):
        away = points - point
        along = away @ direction
        off = np.linalg.norm(away - np.outer(along, direction), axis=1)
        if feature == "line":
            return 2 * off.max()
        if feature == "plane":
            return np.ptp(along)
        d = np.linalg.norm(away, axis=1) if feature == "sphere" else off * np.cos(angle) - along * np.sin(angle)
        return {"MZC": np.ptp(d), "MCC": d.max(), "MIC": -d.min()}[reference]

    direction = np.zeros(3) if found.direction is None else found.direction
    best = width(found.point, direction, found.half_angle or 0.0)
    assert best == pytest.approx(
        {"MCC": found.radius, "MIC": -(found.radius or 0.0)}.get(reference, found.form), abs=1e-9
    )
    for _ in range(2000):
        size = 10.0 ** -rng.uniform(2, 8)
        turned = direction + rng.normal(0, size / 20, 3) if direction.any() else direction
        turned = turned / max(np.linalg.norm(turned), 1e-300)
        angle = (found.half_angle or 0.0) + rng.normal(0, size / 20)
        assert width(found.point + rng.normal(0, size, 3), turned, angle) >= best - 1e-12


@pytest.mark.parametrize("reference", ["MZC", "MIC", "MCC"])
def test_cylinder_zones_can_not_be_bettered_by_a_small_move(reference):
    rng = np.random.default_rng(5)
    t, h = rng.uniform(0, 2 * np.pi, 400), rng.uniform(-20, 20, 400)
    r = 12.5 + rng.normal(0, 0.005, 400)
    points = np.column_stack([r * np.cos(t), r * np.sin(t), h])
    found = evaluate(points, "cylinder", reference)
    assert found.certificate.imbalance < 1e-9

    def worth(point, direction):
        away = points - point
        d = np.linalg.norm(away - np.outer(away @ direction, direction), axis=1)
        return {"MZC": np.ptp(d), "MCC": d.max(), "MIC": -d.min()}[reference]

    best = worth(found.point, found.direction)
    for _ in range(2000):
        size = 10.0 ** -rng.uniform(2, 8)
        direction = found.direction + rng.normal(0, size / 20, 3)
        moved = worth(found.point + rng.normal(0, size, 3), direction / np.linalg.norm(direction))
        assert moved >= best - 1e-12


def test_a_perfect_feature_has_no_form():
    t = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.column_stack([5 * np.cos(t), 5 * np.sin(t), np.zeros(24)])
    for reference in ("LSC", "MZC", "MCC", "MIC"):
        found = evaluate(ring, "circle", reference)
        assert found.form < 1e-12
        assert found.radius == pytest.approx(5, abs=1e-12)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("upr", [2, 15, 30, 50, 75, 100])
def test_the_filter_transmits_what_the_standard_says(even, upr):
    rng = np.random.default_rng(upr)
    n = 3600
    t = 2 * np.pi * (np.arange(n) + (0 if even else rng.uniform(-0.4, 0.4, n))) / n
    order = rng.permutation(n)
    passed = upr_filter(t[order], np.cos(upr * t[order] - 1.0), UprFilter(50.0))
    expected = float(UprFilter(50.0).transmission(np.array([upr]))[0])
    assert expected == pytest.approx(2.0 ** -((upr / 50) ** 2), rel=1e-12)
    assert np.abs(passed - expected * np.cos(upr * t[order] - 1.0)).max() < 1e-4 * max(expected, 1e-2)


@pytest.mark.parametrize("even", [True, False])
def test_the_sharp_filter_lets_all_pass_up_to_its_cut_off(even):
    rng = np.random.default_rng(1)
    t = 2 * np.pi * (np.arange(3600) + (0 if even else rng.uniform(-0.4, 0.4, 3600))) / 3600
    for upr, passes in ((3, 1.0), (50, 1.0), (51, 0.0), (120, 0.0)):
        passed = upr_filter(t, np.cos(upr * t - 1.0), UprFilter(50.0, "sharp"))
        # beside the cut-off an uneven profile lends the last waves a little of the next
        assert np.abs(passed - passes * np.cos(upr * t - 1.0)).max() < (1e-9 if even else 0.1)


def test_an_open_profile_is_not_filtered():
    t = np.radians(np.arange(0, 350, 0.1))
    points = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    with pytest.raises(NotEnoughData, match=r"a gap of 10\.1 degrees"):
        evaluate(points, "circle", "LSC", UprFilter(15.0))


def test_the_noise_floor_says_what_noise_alone_fakes():
    """30 rings of pure noise: the form they read is the floor, within its scatter."""
    t = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    for low_pass, slack in ((None, 0.04), (UprFilter(50.0), 0.15), (UprFilter(50.0, "sharp"), 0.15)):
        read, floor = [], []
        for seed in range(30):
            r = 10 + np.random.default_rng(seed).normal(0, 0.005, t.size)
            found = evaluate(np.column_stack([r * np.cos(t), r * np.sin(t), 0 * t]), "circle", "LSC", low_pass)
            read.append(found.form)
            floor.append(found.noise_floor)
        assert np.mean(floor) == pytest.approx(np.mean(read), rel=slack)


@pytest.mark.slow
@pytest.mark.parametrize("reference", tried(["LSC", "MZC"], "MIC", "MCC"))
def test_the_uncertainty_covers_the_truth_of_a_round_part(reference):
    """x of the centre of 200 noisy rings lies within U in 95 % (190); 181 is three standard deviations below."""
    t = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    inside = 0
    for seed in range(200):
        r = 10 + np.random.default_rng(seed).normal(0, 0.005, t.size)
        found = evaluate(np.column_stack([r * np.cos(t), r * np.sin(t), 0 * t]), "circle", reference)
        inside += abs(found.point[0]) <= found.U["point"]
    assert inside >= 181


def noisy(feature, rng, n, noise=0.005):
    """A perfect feature of radius 10 mm with ``noise`` square to it."""
    t, h, e = rng.uniform(0, 2 * np.pi, n), rng.uniform(-10, 10, n), rng.normal(0, noise, (2, n))
    match feature:
        case "profile":
            return np.column_stack([h, e[0], 0 * h])
        case "line":
            return np.column_stack([h, *e])
        case "plane":
            return np.column_stack([h, 10 * np.cos(t), e[0]])
        case "sphere":
            u = rng.normal(size=(n, 3))
            return u * ((10 + e[0]) / np.linalg.norm(u, axis=1))[:, None]
    r = 10 + e[0]
    return np.column_stack([r * np.cos(t), r * np.sin(t), 0 * h if feature == "circle" else h])


@pytest.mark.parametrize(
    ("feature", "reference"),
    tried(
        [("circle", "LSC"), ("cylinder", "MZC"), ("circle", "MIC"), ("line", "LSC"), ("profile", "MZC")],
        ("cylinder", "MIC"), ("cylinder", "MCC"), ("sphere", "MZC"), ("sphere", "MCC"), ("plane", "MZC"),
    ),
)  # fmt: skip
def test_what_noise_alone_widens_stands_in_the_uncertainty(feature, reference):
    """10 perfect features read the noise as their form, and its half from an inscribed radius: 10 +- 3.5 um for 0."""
    for seed in range(10):
        points = noisy(feature, np.random.default_rng(seed), 300)
        found = evaluate(points, "line" if feature == "profile" else feature, reference)
        assert found.form <= found.U["form"] <= 1.001 * found.form
        if found.radius is not None:
            assert abs(found.radius - 10) <= found.U["radius"]


def test_form_beyond_the_noise_has_the_uncertainty_of_its_noise():
    """Three lobes of 0.1 mm read 0.2 mm and some noise: U holds that, and not the form."""
    rng = np.random.default_rng(0)
    t = np.linspace(0, 2 * np.pi, 5000, endpoint=False)
    r = 10 + 0.1 * np.cos(3 * t) + rng.normal(0, 0.001, t.size)
    for reference in ("LSC", "MZC"):
        found = evaluate(np.column_stack([r * np.cos(t), r * np.sin(t), 0 * t]), "circle", reference)
        assert 0.2 < found.form < 0.21
        assert found.form - 0.2 <= found.U["form"] < 0.012


@pytest.mark.parametrize("feature", ["profile", "line"])
def test_the_noise_of_a_line_is_that_of_its_points(feature):
    """Of a profile it was taken for 1.4 times less, of a line in space for 1.5 times."""
    found = evaluate(noisy(feature, np.random.default_rng(0), 4000), "line")
    assert found.noise == pytest.approx(0.005, rel=0.05)
    assert found.noise_floor == pytest.approx(found.form, rel=0.1)


@pytest.mark.parametrize("feature", ["line", "plane", "circle", "cylinder", "sphere", "cone"])
def test_what_leaves_a_feature_open_is_refused(feature):
    with pytest.raises(NotEnoughData):
        associate(np.zeros((1, 3)), feature)
    with pytest.raises(NotEnoughData):
        associate(np.zeros((20, 3)), feature)
    if feature != "line":
        with pytest.raises(NotEnoughData, match="on one line"):
            associate(np.arange(30.0)[:, None] * np.ones(3), feature)


def test_an_arc_holds_no_inscribed_circle():
    t = np.linspace(0, 1.0, 50)
    points = np.column_stack([np.cos(t), np.sin(t) + 1e-3 * np.sin(9 * t), 0 * t])
    with pytest.raises(NotEnoughData, match="don't hold"):
        evaluate(points, "circle", "MIC")


@pytest.mark.parametrize(("feature", "number"), [("line", 2), ("plane", 3), ("circle", 3), ("sphere", 4)])
def test_points_that_are_just_enough_tell_no_form(feature, number):
    """Whatever they are, they fit: 3 points of a circle were *valid*, with U = 0.000 um of its minimum zone."""
    points = np.array([[0.0, 0.0, 0.0], [5.0, 1.0, 0.5], [1.0, 6.0, -1.0], [2.0, 2.0, 7.0]])[:number]
    for reference in ("LSC", "MZC"):
        assert [r.code for r in evaluate(points, feature, reference).reasons] == ["no_redundant_points"]


def test_a_cut_off_that_no_profile_has_is_refused():
    with pytest.raises(BadRecipe, match="up to 100000"):
        UprFilter(float("inf"))


def test_references_and_filters_are_for_round_features():
    points = np.random.default_rng(0).normal(size=(20, 3))
    with pytest.raises(BadRecipe, match="for a plane, need LSC or MZC"):
        evaluate(points, "plane", "MIC")
    with pytest.raises(BadRecipe, match="circular profile"):
        evaluate(points, "cylinder", "LSC", UprFilter(50.0))
    with pytest.raises(BadRecipe, match="need a positive one"):
        UprFilter(0.0)


def lobed(rng, t, amplitude):
    """Deviations of lobes 2 to 15, as large as the numbers say on most parts: falling with their number."""
    n = np.arange(2, 16)
    a, b = rng.normal(0, amplitude, (2, n.size)) / n
    return np.cos(np.outer(t, n)) @ a + np.sin(np.outer(t, n)) @ b


@pytest.mark.parametrize("arc", tried([60, 180], 120, 270))
def test_form_that_is_seen_in_part_stands_in_the_uncertainty(arc):
    """Centre and radius of 100 lobed arcs: in U in 95 %, of few degrees of freedom somewhat less; 84 is three standard
    deviations below 93. Taken for noise, the form left 1 of 100 (60 degrees) and 4 (180) within U.
    """
    t, inside = np.radians(arc) * np.arange(300) / 300, 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        r = 10 + lobed(rng, t, 0.01) + rng.normal(0, 0.001, t.size)
        found = evaluate(np.column_stack([r * np.cos(t), r * np.sin(t), 0 * t]), "circle")
        inside += abs(found.radius - 10) <= found.U["radius"] and abs(found.point[0]) <= found.U["point"]
    assert inside >= 84


def test_all_round_form_moves_no_centre_and_little_of_its_uncertainty():
    t = 2 * np.pi * np.arange(720) / 720
    r = 10 + 0.01 * np.cos(3 * t)
    found = evaluate(np.column_stack([r * np.cos(t), r * np.sin(t), 0 * t]), "circle")
    assert np.linalg.norm(found.point) < 1e-6
    assert found.U["point"] < 0.001


@pytest.mark.parametrize("feature", ["cylinder", "sphere", "cone"])
def test_a_quarter_of_a_lobed_surface_has_more_doubt_than_all_of_it(feature):
    rng = np.random.default_rng(0)
    U = []
    for share in (1.0, 0.25):
        t, s = rng.uniform(0, 2 * np.pi * share, 2000), rng.uniform(-1, 1, 2000)
        e = lobed(np.random.default_rng(1), t, 0.01)
        if feature == "sphere":
            u = np.column_stack([np.sqrt(1 - s**2) * np.cos(t), np.sqrt(1 - s**2) * np.sin(t), s])
            points = (10 + e)[:, None] * u
        else:
            r = 10 + e + (s if feature == "cone" else 0)
            points = np.column_stack([r * np.cos(t), r * np.sin(t), 5 * s])
        U.append(evaluate(points, feature).U["point"])
    assert U[1] > 5 * U[0]


def test_the_noise_is_not_more_than_what_is_left():
    """Far apart, neighbours differ by form: a ring of 20 points with ten lobes."""
    t = 2 * np.pi * np.arange(20) / 20
    r = 10 + 0.1 * np.cos(7 * t)
    found = evaluate(np.column_stack([r * np.cos(t), r * np.sin(t), 0 * t]), "circle")
    assert found.noise < 0.1
    assert found.noise_floor <= found.form


@pytest.mark.parametrize("feature", ["line", "plane", "circle", "cylinder", "sphere", "cone"])
def test_points_of_something_else_are_doubted(feature):
    blob = np.random.default_rng(5).normal(size=(60, 3)) * [3, 2, 1]
    assert any("check that they are" in r for r in evaluate(blob, feature).reasons)


def test_points_that_leave_a_feature_open_are_doubted():
    rng = np.random.default_rng(0)
    t = np.radians(np.linspace(0, 5, 100))
    r = 100 + rng.normal(0, 0.01, 100)
    arc = np.column_stack([r * np.cos(t), r * np.sin(t), 0 * t])
    assert any("leave the circle open" in r for r in evaluate(arc, "circle").reasons)
    assert evaluate(rough_circle(200, 0), "circle").reasons == ()


def rings(height, noise, n=144):
    """Two rings of 5 mm radius, ``height`` mm apart."""
    t = 2 * np.pi * np.arange(n) / n
    e = np.random.default_rng(0).normal(0, noise, (2, n))
    z = np.where(np.arange(n) < n // 2, height / 2, -height / 2) + e[1]
    return np.column_stack([(5 + e[0]) * np.cos(2 * t), (5 + e[0]) * np.sin(2 * t), z])


@pytest.mark.parametrize("reference", ["LSC", "MZC"])
@pytest.mark.parametrize(("height", "noise"), [(2.0, 0.0), (0.04, 0.0), (0.6, 0.005), (2.0, 0.1)])
def test_points_that_lie_in_no_plane_are_doubted_as_a_circle(height, noise, reference):
    """Two rings of a cylinder were *valid* with a perfect roundness."""
    assert [r.code for r in evaluate(rings(height, noise), "circle", reference).reasons] == ["out_of_plane"]


def test_noise_over_a_circle_s_plane_is_no_doubt():
    """Of as much as in it, of five times as much, of few points, through a filter, and of a section a little thick."""
    for seed in range(50):
        e = np.random.default_rng(seed).normal(0, 0.002, (2, 5))
        t = 2 * np.pi * np.arange(5) / 5
        few = np.column_stack([(5 + e[0]) * np.cos(t), (5 + e[0]) * np.sin(t), e[1]])
        assert evaluate(few, "circle").reasons == ()
    assert evaluate(rings(0.0, 0.005), "circle", "LSC", UprFilter(5.0)).reasons == ()
    assert evaluate(rings(0.0, 0.005) * [1, 1, 5], "circle").reasons == ()
    assert evaluate(rings(0.015, 0.0), "circle").reasons == ()


@pytest.mark.parametrize("reference", ["LSC", "MZC"])
def test_points_given_twice_count_once(reference):
    """Their noise read 0, and U of the radius 1.4 times too little."""
    once = rough_circle(72, 0)
    expected = evaluate(once, "circle", reference)
    for twice in (np.vstack([once, once]), np.repeat(once, 2, axis=0), np.vstack([once, once * (1 + 2e-16)])):
        found = evaluate(twice, "circle", reference)
        assert [r.code for r in found.remarks] == ["points_repeated"]
        assert (found.n, found.deviation.size) == (72, 144)
        assert pytest.approx(expected.U) == found.U
        assert found.form == pytest.approx(expected.form, abs=1e-12)
    assert np.array_equal(found.deviation[:72], found.deviation[72:])
    assert expected.remarks == ()


@pytest.mark.slow
@pytest.mark.parametrize("feature", ["cylinder", "cone"])
def test_a_ring_tells_no_axis(feature):
    """Of 60 rings 38 were *valid* cylinders, and 13 of these turned by up to 3 U."""
    t = 2 * np.pi * np.arange(90) / 90
    for seed in range(10):
        rng = np.random.default_rng(seed)
        r = 5 + rng.normal(0, 0.001, 90)
        ring = np.column_stack([r * np.cos(t), r * np.sin(t), rng.normal(0, 0.001, 90)])
        assert "feature_open" in [reason.code for reason in evaluate(ring, feature).reasons]
    assert evaluate(noisy("cylinder", rng, 60), "cylinder").reasons == ()


@pytest.mark.parametrize("feature", ["circle", "cylinder"])
def test_half_a_circumference_holds_no_circumscribed_feature(feature):
    """Its two ends do: the centre was 80 um off at U 0.08, *valid*."""
    t = np.pi * np.arange(80) / 80
    r = 4 + np.random.default_rng(0).normal(0, 5e-5, 80)
    h = 0 * t if feature == "circle" else np.tile([-3.0, -1, 1, 3], 20)
    found = evaluate(np.column_stack([r * np.cos(t), r * np.sin(t), h]), feature, "MCC")
    assert "held_on_one_side" in [reason.code for reason in found.reasons]
    assert evaluate(rough_circle(200, 0), "circle", "MCC").reasons == ()


@pytest.mark.parametrize("reference", ["MZC", "MCC", "MIC"])
def test_the_direction_of_a_circle_has_its_doubt_with_every_reference(reference):
    points = rough_circle(60, 0) + np.random.default_rng(1).normal(0, 0.01, (60, 1)) * [0, 0, 1]
    found, least = (evaluate(points, "circle", kind) for kind in (reference, "LSC"))
    assert found.U["direction"] == least.U["direction"] > 0


def test_contacts_count_among_all_points():
    points = np.vstack([np.full((2, 3), np.nan), rough_circle(40, 0)])
    found = evaluate(np.insert(points, 5, points[4], axis=0), "circle", "MZC")
    away = found.deviation[found.certificate.contacts]
    assert np.abs(away) == pytest.approx(found.form / 2, abs=1e-12)
    assert np.array_equal(away > 0, found.certificate.outside)


def test_deviations_keep_to_the_points():
    points = rough_circle(50, 0)
    points[[3, 17]] = np.nan
    found = evaluate(points, "circle")
    assert found.n == 48
    assert np.flatnonzero(np.isnan(found.deviation)).tolist() == [3, 17]


def test_an_arc_says_what_it_may_not_show():
    """Two lobes of 10 um on a quarter read as another radius, 34 um off: nothing in the points tells."""
    t = np.radians(90) * np.arange(200) / 200
    ellipse = 10 + 0.01 * np.cos(2 * t)
    found = evaluate(np.column_stack([ellipse * np.cos(t), ellipse * np.sin(t), 0 * t]), "circle")
    moved = np.linalg.norm(found.point) / 0.01
    (remark,) = found.remarks
    stated = float(remark.split("up to ")[1].split()[0])
    assert 1.5 < moved < 1.1 * stated
    assert evaluate(rough_circle(200, 0), "circle").remarks == ()


@pytest.mark.parametrize("height", [1e-3, 1e-2, 0.05])
def test_one_circle_of_a_sphere_holds_no_sphere(height):
    """A ring of 1 um at 42 degrees, 5 um of noise: the centre was 9 mm off at U 0.07, *valid*."""
    rng = np.random.default_rng(0)
    turn, up = rng.uniform(0, 2 * np.pi, 200), 10 * np.sin(0.73) + rng.uniform(-height, height, 200)
    out = np.sqrt(100 - up**2)
    ring = np.column_stack([out * np.cos(turn), out * np.sin(turn), up])
    noisy = ring * (1 + rng.normal(0, 5e-4, 200))[:, None]
    assert [r.code for r in evaluate(noisy, "sphere").reasons] == ["feature_open"]
    up = rng.uniform(-5, 5, 200)
    out = np.sqrt(100 - up**2)
    band = np.column_stack([out * np.cos(turn), out * np.sin(turn), up])
    assert evaluate(band * (1 + rng.normal(0, 5e-4, 200))[:, None], "sphere").reasons == ()


@pytest.mark.parametrize("shift", [1e-9, 1e-7, 1e-6])
def test_a_profile_given_twice_with_a_tiny_shift_is_doubted(shift):
    """Its points are their own neighbours: noise of 3 um read as 0.00006."""
    rng = np.random.default_rng(0)
    turn = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    out = 10 + rng.normal(0, 0.003, 200)
    once = np.column_stack([out * np.cos(turn), out * np.sin(turn), np.zeros(200)])
    twice = np.vstack([once, once + shift * np.array([1.0, 0.5, 0.0])])
    assert [r.code for r in evaluate(twice, "circle").reasons] == ["points_nearly_repeated"]
    again = np.vstack([once, once + rng.normal(0, 0.003, (200, 3)) * [1, 1, 0]])
    assert evaluate(again, "circle").reasons == ()
