"""What the compiled truth plant is told of a machine: records of its links, cylinders and oil.

Records carry the names; in numba they cost no reference counts, as tuples of arrays would.
Pressures are gauge, flows positive into a chamber.

Arguments that the modules of the compiled plant share:

- `links`, `frames`, `cyls` and `world`: arrays of the records below, filled by
  `hydro_hw_bridge.rig.plant`; `link`, `frame`, `cyl` and `oil`: one of them;
- `jac`, `matrix`, `bias` and `work`: working memory, of `jac` `rows` for a point's velocity per
  joint rate; `matrix` and `bias` become mass matrix (its lower triangle) and bias;
- `y`: the state as `Plant` lays it out; `asked`: spool positions by cylinder, held over a cycle of
  `cycle_s` in `steps` fixed steps; `pump`: False while it is off;
- `force`: of or about the joints (n,); `x`, `v`: of a piston; `p_va`, `p_vb`: pressures at the
  valve's ports, those of the chambers where there are no hoses; `time`: of the plant, s.
"""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.rig.extras import CYLINDER_FIELDS, JOINT_FIELDS

_MATRIX, _VECTOR = ("f8", (3, 3)), ("f8", (3,))

#: A moving link and the joint that moves it: child axes in the parent frame are
#: ``turn_0 + sin q turn_sin + (1 - cos q) turn_cos``; offset and axis are in the parent frame,
#: centre of mass and central inertia in the link's.
LINK = np.dtype(
    [
        ("turn_0", *_MATRIX),
        ("turn_sin", *_MATRIX),
        ("turn_cos", *_MATRIX),
        ("offset", *_VECTOR),
        ("axis", *_VECTOR),
        ("prismatic", "i8"),
        ("stopped", "i8"),
        ("lower", "f8"),
        ("upper", "f8"),
        ("mass", "f8"),
        ("com", *_VECTOR),
        ("inertia", *_MATRIX),
        *((name, "f8") for name in JOINT_FIELDS),
    ]
)

#: A frame in motion, in base axes; the two rates leave out joint accelerations. Frame 0 is the
#: base, frame i + 1 link i, whose joint turns about `axis`.
FRAME = np.dtype(
    [
        ("rotation", *_MATRIX),
        ("origin", *_VECTOR),
        ("spin", *_VECTOR),
        ("velocity", *_VECTOR),
        ("spin_rate", *_VECTOR),
        ("acceleration", *_VECTOR),
        ("axis", *_VECTOR),
    ]
)

#: A cylinder with its valve. Pins are in the frames of the links before and after the joint;
#: barrel and rod have mass, distance from their own pin and transverse central inertia;
#: `spool_rate` is the natural frequency in rad/s. `lever`, `x` and `v` are results.
CYLINDER = np.dtype(
    [
        ("joint", "i8"),
        ("direct", "i8"),
        ("heavy", "i8"),
        ("extra", "i8"),
        ("parent_pin", *_VECTOR),
        ("child_pin", *_VECTOR),
        ("barrel", *_VECTOR),
        ("rod", *_VECTOR),
        *(
            (name, "f8")
            for name in (
                *("closed_length", "full_stroke", "area_a", "area_b", "dead_a", "dead_b"),
                *("leak", "leak_a", "leak_b", "viscous", "coulomb", "static"),
                *("stribeck_velocity", "bristle", "bristle_damping"),
                *("c_pa", "c_at", "c_pb", "c_bt", "deadband", "rounding", "null"),
                *("spool_rate", "spool_damping", "spool_limit", "transition"),
                *("lever", "x", "v"),
                *CYLINDER_FIELDS,
                *("disturbance", "shake"),
            )
        ),
    ]
)

#: What all share: gravity in the base frame, the oil and the lines.
WORLD = np.dtype(
    [
        ("gravity", *_VECTOR),
        ("tip", *_VECTOR),
        ("extra", "i8"),
        *(
            (name, "f8")
            for name in (
                *("time", "contact_stiffness", "contact_height", "contact_damping"),
                *("supply_ripple", "supply_ripple_rate"),
                *("bulk_modulus", "low_pressure_loss", "low_pressure_scale", "atmosphere"),
                *("supply", "tank", "droop", "droop_quadratic", "droop_lag"),
                *("tank_resistance", "tank_lag"),
            )
        ),
    ]
)
