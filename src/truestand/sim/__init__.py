"""The virtual stand: scans of a shaft with their truth, for training, demos and tests.

A ray caster in the laboratory's frame. It shares no code with the estimator that it tests; only the types of scans,
stands and artefacts are common (checked by import-linter).
"""

from truestand.sim.gear_errors import Chip, Dent, FlankErrors, GearErrors, Scratch, Worn
from truestand.sim.parts import VirtualCad, VirtualGear, VirtualPart, VirtualTurned
from truestand.sim.recipe import simulation_from, virtual_part_from
from truestand.sim.simulate import Simulated, simulate
from truestand.sim.simulation import (
    Acquisition,
    FormWave,
    Keyway,
    Misalignment,
    Mounting,
    Optics,
    Patch,
    Running,
    Simulation,
    Workpiece,
    paper_shaft,
    paper_simulation,
    paper_stand,
)
from truestand.sim.truth import Truth, truth_record

__all__ = [
    "Acquisition",
    "Chip",
    "Dent",
    "FlankErrors",
    "FormWave",
    "GearErrors",
    "Keyway",
    "Misalignment",
    "Mounting",
    "Optics",
    "Patch",
    "Running",
    "Scratch",
    "Simulated",
    "Simulation",
    "Truth",
    "VirtualCad",
    "VirtualGear",
    "VirtualPart",
    "VirtualTurned",
    "Workpiece",
    "Worn",
    "paper_shaft",
    "paper_simulation",
    "paper_stand",
    "simulate",
    "simulation_from",
    "truth_record",
    "virtual_part_from",
]
