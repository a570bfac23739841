"""A box as a STEP file (AP214): six planes, in mm."""

from itertools import pairwise

import numpy as np

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));
ENDSEC;
DATA;
"""
LOOPS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


class Step:
    """Entities, numbered as they come."""

    def __init__(self):
        self.lines = []

    def add(self, name, *arguments):
        body = name if name.startswith("(") else f"{name}({','.join(arguments)})"
        self.lines.append(f"#{len(self.lines) + 1}={body};")
        return f"#{len(self.lines)}"

    def named(self, name, *arguments):
        return self.add(name, "''", *arguments)

    def triple(self, name, p):
        return self.named(name, f"({p[0]:.6f},{p[1]:.6f},{p[2]:.6f})")


def many(items):
    return f"({','.join(items)})"


def step_box(size, at):
    step = Step()
    corner = np.array([[i >> 2, i >> 1 & 1, i & 1] for i in range(8)]) * size + at
    solid = step.named("MANIFOLD_SOLID_BREP", step.named("CLOSED_SHELL", many(_faces(step, corner))))
    mm = step.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")
    rad = step.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    steradian = step.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
    doubt = step.add("UNCERTAINTY_MEASURE_WITH_UNIT", "LENGTH_MEASURE(1.E-07)", mm, "''", "''")
    context = step.add(
        f"(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({doubt}))"
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({mm},{rad},{steradian}))REPRESENTATION_CONTEXT('',''))"
    )
    shape = step.named(
        "ADVANCED_BREP_SHAPE_REPRESENTATION", many([_place(step, (0, 0, 0), (0, 0, 1), (1, 0, 0)), solid]), context
    )
    application = step.add("APPLICATION_CONTEXT", "'automotive design'")
    product = step.add(
        "PRODUCT", "'box'", "'box'", "''", many([step.named("PRODUCT_CONTEXT", application, "'mechanical'")])
    )
    formation = step.named("PRODUCT_DEFINITION_FORMATION", "''", product)
    design = step.named("PRODUCT_DEFINITION_CONTEXT", application, "'design'")
    definition = step.named("PRODUCT_DEFINITION", "''", formation, design)
    step.add("SHAPE_DEFINITION_REPRESENTATION", step.named("PRODUCT_DEFINITION_SHAPE", "''", definition), shape)
    return HEAD + "\n".join(step.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"


def _place(step, origin, axis, along):
    parts = step.triple("CARTESIAN_POINT", origin), step.triple("DIRECTION", axis), step.triple("DIRECTION", along)
    return step.named("AXIS2_PLACEMENT_3D", *parts)


def _faces(step, corner):
    vertex = [step.named("VERTEX_POINT", step.triple("CARTESIAN_POINT", p)) for p in corner]
    edges, faces = {}, []
    for loop in LOOPS:
        oriented = []
        for a, b in pairwise((*loop, loop[0])):
            if (b, a) not in edges:
                along = (corner[b] - corner[a]) / np.linalg.norm(corner[b] - corner[a])
                way = step.named("VECTOR", step.triple("DIRECTION", along), "1.")
                line = step.named("LINE", step.triple("CARTESIAN_POINT", corner[a]), way)
                edges[a, b] = step.named("EDGE_CURVE", vertex[a], vertex[b], line, ".T.")
            edge, sense = (edges[a, b], ".T.") if (a, b) in edges else (edges[b, a], ".F.")
            oriented.append(step.named("ORIENTED_EDGE", "*", "*", edge, sense))
        along = corner[loop[1]] - corner[loop[0]]
        across = np.cross(along, corner[loop[2]] - corner[loop[1]])
        bound = step.named("FACE_OUTER_BOUND", step.named("EDGE_LOOP", many(oriented)), ".T.")
        plane = step.named("PLANE", _place(step, corner[loop[0]], across, along))
        faces.append(step.named("ADVANCED_FACE", many([bound]), plane, ".T."))
    return faces
