"""Figures to play with: a teddy bear, a lego man, a robot."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.creatures.parts import beady_eyes, curl, patch, pillow
from export.everyday_objects.data.shapes import (
    DARK,
    GOLD,
    RED,
    WHITE,
    Limb,
    Lump,
    Part,
    bar,
    blend,
    both_sides,
    box,
    cushion,
    ellipsoid,
    fixed,
    frustum,
    lathe,
    moved,
    role,
    torus,
    tube,
    turned,
)


def teddy_bear(rng: np.random.Generator) -> list[Part]:
    """A sitting toy bear: round belly, big head with round ears and a muzzle, a bow; at times a jacket."""
    fat, head, arm = rng.uniform(0.95, 1.08), rng.uniform(0.98, 1.08), rng.uniform(0.45, 0.7)
    y = 0.84
    shoulder, hand = np.array((0.22, 0.52, 0.03)), np.array((0.27 + 0.2 * arm, 0.56 - 0.34 * arm, 0.22))
    belly = Lump((0, 0.36, 0), (0.3 * fat, 0.33, 0.26 * fat))
    mirror = np.array((-1.0, 1.0, 1.0))
    fur = blend(
        [
            belly,
            Lump((0, y, 0.03), (0.3 * head, 0.265 * head, 0.26 * head)),
            *(Limb(shoulder * m, hand * m, 0.105, 0.105) for m in (mirror, 1.0)),
            *(Limb((s * 0.15, 0.16, 0.1), (s * 0.25, 0.14, 0.4), 0.14, 0.125) for s in (-1, 1)),
            *(Lump((s * 0.24 * head, y + 0.22 * head, 0), (0.115, 0.115, 0.065)) for s in (-1, 1)),
            Lump((0, 0.14, -0.25 * fat), (0.09, 0.09, 0.09)),
        ],
        role("fur"),
    )
    front = y - 0.075, 0.03 + 0.24 * head
    parts = [
        fur,
        ellipsoid((0.15, 0.115, 0.115), role("muzzle"), (0, *front)),
        ellipsoid((0.06, 0.045, 0.04), DARK, (0, front[0] + 0.055, front[1] + 0.1)),
        *both_sides(
            ellipsoid((0.07, 0.07, 0.035), role("muzzle"), (0.24 * head, y + 0.22 * head, 0.05)),
            ellipsoid((0.048, 0.052, 0.035), DARK, (0.125 * head, y + 0.055, 0.03 + 0.232 * head)),
            ellipsoid((0.09, 0.095, 0.03), role("muzzle"), (0.256, 0.14, 0.515)),
        ),
    ]
    neck = 0.24 * fat
    if rng.random() < 0.25:  # six of the seeds 0 to 11
        sleeve = shoulder + 0.72 * (hand - shoulder)
        jacket = blend(
            [
                Lump((0, 0.38, 0), (0.325 * fat, 0.32, 0.285 * fat)),
                *(Limb(shoulder * m, sleeve * m, 0.13, 0.13) for m in (mirror, 1.0)),
            ],
            role("jacket"),
            cell=0.032,
        )
        parts += patch(jacket, [Limb((0, 0.6, 0.32), (0, 0.1, 0.32), 0.21, 0.04)], WHITE)
        parts += [ellipsoid((0.038, 0.038, 0.025), DARK, (0, h, 0.285 * fat)) for h in (0.29, 0.42)]
        neck = 0.27 * fat
    else:
        parts.append(ellipsoid((0.2, 0.21, 0.08), role("muzzle"), (0, 0.35, 0.205 * fat)))
        parts.append(torus(0.18, 0.05, role("ribbon"), (0, 0.615, 0.02)))
    bow = pillow([(0, 0.05), (0.17, 0.12), (0.17, -0.12), (0, -0.05)], 0.11, role("ribbon"))
    parts += both_sides(moved(bow, (0.01, 0.585, neck)))
    return [*parts, ellipsoid((0.05, 0.05, 0.06), role("ribbon", 0.8), (0, 0.585, neck))]


def lego_man(rng: np.random.Generator) -> list[Part]:
    """A plastic brick figure: round head with a stud, tapered torso, arms with C hands, block legs."""
    wide, leg, smile = rng.uniform(0.6, 0.66), rng.uniform(0.46, 0.52), rng.uniform(0.03, 0.06)
    skin, hip, torso = fixed(0.97, 0.8, 0.12), leg, leg + 0.13
    neck = torso + 0.48
    head = [
        (0, 0),
        (0.13, 0),
        (0.13, 0.035),
        (0.19, 0.05),
        (0.215, 0.09),
        (0.215, 0.29),
        (0.19, 0.33),
        (0.12, 0.34),
        (0.12, 0.41),
        (0.105, 0.425),
        (0, 0.425),
    ]
    mouth = [
        (0.218 * np.sin(t), neck + 0.12 + smile * (1 - np.cos(2.2 * t)), 0.218 * np.cos(t))
        for t in np.linspace(-0.55, 0.55, 9)
    ]
    shoulder, elbow, wrist = (
        (wide * 0.36, neck - 0.1, 0),
        (wide * 0.6, neck - 0.28, 0.06),
        (wide * 0.66, neck - 0.42, 0.22),
    )
    grip = [
        np.array(wrist) + (0.0, -0.02 + 0.075 * np.cos(t), 0.1 - 0.075 * np.sin(t))
        for t in np.linspace(-0.9, 4.0, 11)
    ]
    limbs = [
        curl([shoulder, elbow, wrist], (0.105, 0.1, 0.085), role("shirt")),
        ellipsoid(0.108, role("shirt"), shoulder),
        tube(grip, 0.055, skin),
        box((wide / 2 - 0.03, leg - 0.02, 0.26), role("legs"), (wide / 4 + 0.005, leg / 2 + 0.02, 0)),
        cushion((wide / 2 - 0.02, 0.15, 0.4), role("legs"), (wide / 4 + 0.005, 0.075, 0.06), 10),
        bar((0.01, leg - 0.02, 0), (wide / 2 - 0.015, leg - 0.02, 0), 0.15, role("legs"), sides=24),
    ]
    return [
        frustum((wide, 0.32), (wide * 0.68, 0.28), 0.48, role("shirt"), (0, torso, 0)),
        box((wide + 0.01, 0.12, 0.3), role("legs", 0.8), (0, hip + 0.08, 0)),
        lathe(head, skin, (0, neck - 0.005, 0)),
        tube(mouth, 0.02, DARK),
        *beady_eyes((0.085, neck + 0.235, 0.193), 0.038),
        *both_sides(*limbs),
    ]


def robot(rng: np.random.Generator) -> list[Part]:
    """A tin toy robot: box head with lamp eyes, a box chest with dials, jointed arms with claws, big feet."""
    wide, tall, head = rng.uniform(0.62, 0.7), rng.uniform(0.5, 0.56), rng.uniform(0.5, 0.56)
    hip = 0.36
    chest, y = hip + tall / 2, hip + tall + 0.08
    joint = fixed(0.2, 0.21, 0.24)
    shoulder = wide / 2 + 0.07
    arm = [
        turned(
            lathe(
                [(0, -0.09), (0.11, -0.09), (0.125, -0.05), (0.125, 0.05), (0.11, 0.09), (0, 0.09)],
                role("limbs"),
            ),
            2,
            np.pi / 2,
        ),
        bar((0.05, 0, 0), (0.1, -0.24, 0.04), 0.07, joint),
        bar((0.085, -0.17, 0.03), (0.11, -0.33, 0.08), 0.1, role("limbs"), 1.1),
        *(
            curl(
                [(0.11, -0.33, 0.08), (0.11 + d, -0.42, 0.12), (0.11 + 0.6 * d, -0.52, 0.16)],
                (0.055, 0.055, 0.04),
                joint,
            )
            for d in (-0.1, 0.1)
        ),
    ]
    leg = [
        bar((0.17, 0.1, 0), (0.17, hip + 0.05, 0), 0.09, joint),
        lathe([(0.12, 0.17), (0.13, 0.19), (0.13, 0.25), (0.12, 0.27)], role("limbs"), (0.17, 0, 0)),
        cushion((0.29, 0.2, 0.46), role("limbs"), (0.18, 0.1, 0.05), 8),
    ]
    ear = turned(
        lathe([(0, 0), (0.1, 0), (0.1, 0.05), (0.05, 0.09), (0, 0.09)], role("limbs")), 2, -np.pi / 2
    )
    face = 0.235
    return [
        cushion((wide, tall, 0.46), role("body"), (0, chest, 0), 12),
        cushion((wide * 0.72, tall * 0.6, 0.08), WHITE, (0, chest + 0.02, 0.22), 12),
        *both_sides(ellipsoid((0.055, 0.055, 0.03), RED, (0.12, chest - 0.06, 0.265))),
        ellipsoid((0.055, 0.055, 0.03), GOLD, (0, chest - 0.06, 0.265)),
        box((wide * 0.5, 0.07, 0.03), joint, (0, chest + 0.08, 0.262)),
        lathe([(0.16, 0), (0.16, 0.1)], joint, (0, y - 0.09, 0)),
        cushion((head, 0.4, 0.42), role("body"), (0, y + 0.18, 0), 12),
        box((head * 0.52, 0.085, 0.05), joint, (0, y + 0.075, 0.2)),
        *(box((0.035, 0.09, 0.03), WHITE, (x, y + 0.075, 0.222)) for x in (-0.08, 0, 0.08)),
        *both_sides(
            moved(
                turned(lathe([(0, 0), (0.105, 0), (0.1, 0.05), (0, 0.05)], joint), 0, np.pi / 2),
                (0.125, y + 0.24, face - 0.045),
            ),
            ellipsoid((0.08, 0.08, 0.05), role("eyes"), (0.125, y + 0.24, face)),
            moved(ear, (head / 2 - 0.02, y + 0.19, 0)),
            *(moved(p, (shoulder, hip + tall - 0.13, 0)) for p in arm),
            *leg,
        ),
        bar((0, y + 0.36, 0), (0, y + 0.46, 0), 0.05, joint),
        ellipsoid(0.085, role("eyes"), (0, y + 0.5, 0)),
    ]


KINDS = (
    Kind(
        ("teddy bear", "toy bear"),
        teddy_bear,
        {"fur": ("brown",), "muzzle": ("beige",), "ribbon": ("red", "blue"), "jacket": ("black", "blue")},
        {"ribbon": "a {} ribbon", "jacket": "a {} jacket"},
        weight=1.2,
    ),
    Kind(
        ("lego man", "lego figure", "minifigure"),
        lego_man,
        {"shirt": ("red", "green"), "legs": ("blue", "black")},
        {"legs": "{} legs"},
    ),
    Kind(
        ("robot", "toy robot"),
        robot,
        {"body": ("grey", "blue"), "limbs": ("red", "orange"), "eyes": ("yellow",)},
        {"limbs": "{} arms and legs", "eyes": "{} eyes"},
    ),
)
