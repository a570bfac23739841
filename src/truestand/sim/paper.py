"""The stand, the shaft and the scan of the paper (Klarák et al., Sensors 2022, 22, 5306), as far as it states them."""

from math import pi, radians

from truestand.core.artefact import Artefact, Cylinder
from truestand.core.stand import Sensor, Stand, Table
from truestand.sim.simulation import FormWave, Optics, Running, Simulation, Workpiece


def paper_stand() -> Stand:
    """200 profiles/s of 640 points, 70..120 mm, pi/10 rad/s."""
    sensor = Sensor("front", 200.0, 640, (70.0, 120.0), linearity_U=0.02)
    return Stand(Table(speed=pi / 10), (sensor,))


def paper_shaft() -> Artefact:
    """Base of 25 mm and bearing of 13.94 mm."""
    return Artefact(
        (Cylinder("base", 25.0, -60.0, 0.0, 0.002), Cylinder("bearing", 13.94, 0.0, 35.0, 0.002, 0.002)), "shaft M"
    )


def paper_simulation() -> Simulation:
    """11,000 profiles, 2.75 turns, 878.9 um of eccentricity, a printed shaft 85 um oval."""
    return Simulation(
        running=Running(eccentricity=0.8789, eccentricity_direction=radians(40.0)),
        workpiece=Workpiece(form=(FormWave("base", 2, 0.085, radians(25.0)),)),
        optics=Optics(noise=0.005),
    )
