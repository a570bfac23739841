"""The exact model: its Jacobian against differences, its own prediction against its own residual."""

from dataclasses import replace

import numpy as np
import pytest

from truestand.calibration.model import Model, Readings

MODEL = Model(
    radii=(12.5, 6.97),
    middles=(-10.0, 15.0),
    height=-71.0,
    start_angle=0.4,
    orders=4,
    static_axis=(0.0, 1.0),
    static_spans=((70.0, 95.0), (95.0, 121.0)),
)


def parameters(rng):
    p = np.zeros(MODEL.size)
    p[:10] = [-0.7296, 75.3, 0.25, 0.005, 0.67, 0.56, 6e-4, -8e-4, 0.002, 0.01]
    p[10:] = rng.normal(0, 0.01, MODEL.size - 10)
    p[MODEL.axis_slice(1)][2:] *= 0.01
    p[MODEL.stretches_slice] *= [0.3, 0.003]
    return p


def readings(rng, n=400):
    return Readings(
        rng.uniform(-12, 12, n),
        rng.uniform(72, 119, n),
        rng.uniform(-10, 20, n),
        rng.uniform(-0.5, 0.5, n),
        rng.integers(0, 2, n),
    )


def on_the_surface(p, r):
    """Readings at the angles, times and cylinders of others, where the model sees the surface."""
    x, z = np.empty_like(r.x), np.empty_like(r.z)
    v = np.linspace(-15.0, 20.0, x.size)
    for k in (0, 1):
        on = r.cylinder == k
        u = MODEL.radial_position(p, v[on], r.angle[on], r.time[on], r.cylinder[on]) + p[8] * r.time[on]
        across, up = u - p[1] - p[8] * r.time[on], v[on] - MODEL.height
        x[on] = -np.cos(p[0]) * across + np.sin(p[0]) * up
        z[on] = np.sin(p[0]) * across + np.cos(p[0]) * up
    return Readings(x, z, r.angle, r.time, r.cylinder)


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("larger", [1.0, 5.0], ids=["form that may be the bearing's", "larger form"])
def test_the_jacobian_is_that_of_the_residuals(larger, noise):
    """Of noisy readings, too: where they lie slopes go along with the noise, and the fit of a nearly centred shaft got
    stuck where the cost said otherwise.
    """
    rng = np.random.default_rng(1)
    p, r = parameters(rng), readings(rng)
    p[MODEL.forms_slice] *= larger
    r = on_the_surface(p, r)
    off = rng.normal(0.0, noise, r.x.size)
    r = replace(r, x=r.x - np.cos(p[0]) * off, z=r.z + np.sin(p[0]) * off)
    _, jacobian = MODEL.linearised(p, r)
    turned = MODEL.turns(p, r)
    for j in range(MODEL.size):
        step = np.zeros(MODEL.size)
        step[j] = 1e-6
        differences = (MODEL.residuals(p + step, r, turned) - MODEL.residuals(p - step, r, turned)) / 2e-6
        assert np.abs(differences - jacobian[:, j]).max() < 1e-4 * max(1.0, np.abs(differences).max()), j


def test_the_predicted_position_has_no_residual():
    rng = np.random.default_rng(2)
    p = parameters(rng)
    v = np.linspace(-15.0, 20.0, 50)
    angle, time = np.linspace(0, 7, 50), np.linspace(-0.5, 0.5, 50)
    for cylinder in (0, 1):
        u = MODEL.radial_position(p, v, angle, time, np.full(50, cylinder))
        side, phi = -1.0, p[0]
        across, up = u - p[1], v - MODEL.height
        x = side * np.cos(phi) * across + np.sin(phi) * up
        z = -side * np.sin(phi) * across + np.cos(phi) * up
        which = np.full(50, cylinder)
        assert np.abs(MODEL.residuals(p, Readings(x, z, angle, time, which))).max() < 1e-7


def test_an_eccentric_circle_seen_radially_has_the_second_harmonic_that_subtraction_leaves():
    """r = e cos t + sqrt(R^2 - e^2 sin^2 t): a perfect shaft keeps e^2/4R once the first harmonic is taken out."""
    p = np.zeros(MODEL.size)
    p[0], p[1], p[4] = -0.7296, 75.3, 0.8789
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    u = MODEL.radial_position(p, np.full(720, -10.0), angle, np.zeros(720), np.zeros(720, dtype=np.intp))
    second = 2 * abs(np.mean(u * np.exp(2j * angle)))
    assert second == pytest.approx(0.8789**2 / (4 * 12.5), rel=2e-3)
