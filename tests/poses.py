"""What tests ask of transforms, worked out apart from ``core.frames``."""

import numpy as np
from scipy.spatial.transform import Rotation

from truestand.core.frames import Pose


def is_proper(pose: Pose) -> bool:
    """A right-handed rotation to 1e-12: no scale, no shear, no mirror."""
    unit = np.abs(pose.rotation @ pose.rotation.T - np.eye(3)).max() <= 1e-12
    return bool(unit and abs(np.linalg.det(pose.rotation) - 1.0) <= 1e-12)


def rotor_from_table(angle: float) -> Pose:
    """Table to rotor at a table angle (rad): p_R = Rz(-angle) p_T."""
    return Pose(Rotation.from_euler("z", -angle).as_matrix(), np.zeros(3))
