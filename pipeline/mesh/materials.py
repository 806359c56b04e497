"""How a surface reflects light: metallic-roughness materials by the words of a prompt, and their MTL file.

The model paints colours only; what a surface is made of, the prompt says or nobody does.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple


class Material(NamedTuple):
    """glTF's metallic-roughness model: both factors in [0, 1]."""

    roughness: float
    metallic: float
    unlit: bool = False
    """The texture is shown as it is, without any light."""


PLAIN = Material(0.55, 0.0)
"""Without a word: the median of the 2,633 materials of Debian's sweethome3d-furniture whose exponent is not
Blender's default (quartiles 0.39 and 1), by roughness^4 = 2 / (Ns + 2)."""
_WORDS = {
    "gold golden brass": Material(0.3, 1.0),
    "silver copper bronze": Material(0.35, 1.0),
    "chrome mirror": Material(0.1, 1.0),
    "steel metal metallic aluminium aluminum tin": Material(0.4, 1.0),
    "iron rusty": Material(0.7, 1.0),
    "glass crystal": Material(0.1, 0.0),
    "porcelain ceramic glazed lacquered": Material(0.2, 0.0),
    "marble": Material(0.3, 0.0),
    "plastic lego candy": Material(0.4, 0.0),
    "leather": Material(0.5, 0.0),
    "wooden wood": Material(0.65, 0.0),
    "rubber": Material(0.8, 0.0),
    "stone brick bricks concrete clay gingerbread": Material(0.95, 0.0),
    "wool woollen knitted velvet fabric cloth plush fluffy": Material(1.0, 0.0),
}
MATERIALS = {word: material for words, material in _WORDS.items() for word in words.split()}
"""By word; the first of a prompt that is here decides."""
_NAMES = re.compile(r"\b(golden (retriever|eagle|hamster)|stone age|iron man|tin man)\b")
"""What is called after a material and is not made of it."""


def material_of(prompt: str, unlit: bool) -> tuple[Material, str]:
    """Return the material that a prompt speaks of, and its word ("": it names none, and gets `PLAIN`)."""
    words = re.findall(r"[^\W\d_]+", _NAMES.sub("", prompt.lower()))
    word = next((word for word in words if word in MATERIALS), "")
    return MATERIALS.get(word, PLAIN)._replace(unlit=unlit), word


def object_name(prompt: str) -> str:
    """Return the name of the object that a prompt asks for: `red_armchair` for "a red armchair".

    Letters and digits of any script, joined by underscores, at most 48 of them: what engines, shells and
    OBJ files take. "asset" where nothing is left.
    """
    words = re.findall(r"[^\W_]+", prompt.lower())
    while len(words) > 1 and words[0] in ("a", "an", "the"):
        words = words[1:]
    return "_".join(words)[:48].strip("_") or "asset"


def mtl_text(names: Sequence[str], material: Material, texture: str, normal_map: str = "") -> str:
    """Return an MTL file with a material of each name, all alike: the texture as diffuse colour.

    Lit ones have a highlight (illum 2) as wide as the roughness (Ns = 2 / roughness^4 - 2, where Phong's and
    GGX's widths agree: Walter et al. 2007), and roughness and metallic themselves (Pr, Pm) for programs that
    know them. Unlit is illum 0, a constant colour.
    """
    metal, rough = material.metallic, material.roughness
    shine = min(max(2 / max(rough, 0.05) ** 4 - 2, 0.0), 1000.0)
    grey = "0" if material.unlit else f"{0.04 + 0.46 * metal:.2f}"
    lines = ["Ka 0 0 0", "Kd 1 1 1", f"Ks {grey} {grey} {grey}", f"Ns {shine:.4g}"]
    lines += [f"illum {0 if material.unlit else 2}"]
    lines += [] if material.unlit else [f"Pr {rough:g}", f"Pm {metal:g}"]
    lines += [f"map_Kd {texture}", *([f"norm {normal_map}"] if normal_map else [])]
    return "\n".join(f"newmtl {name}\n" + "\n".join(lines) + "\n" for name in names)
