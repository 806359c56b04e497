"""Look at kinds: `python -m export.everyday_objects.data.sheet OUT.png animals horse deer [--variants 6]`.

The second word is a package of `makers`, further ones are kinds in it, all where none is named.

A row a variant: its natural colours from the front right, left, behind, above and level front; then in a
colour word, with its parts in colours of their own, and in a material. Pictures are what the model is trained
on, enlarged twice. With --decoded they have gone through the autoencoder: what a model can show at best.
"""

import argparse
import importlib
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.looks import Look, dress
from export.everyday_objects.data.materials import MATERIALS
from export.everyday_objects.data.render import drawable, render
from export.everyday_objects.data.shapes import assemble
from pipeline.cameras import orbit_camera

_VIEWS = ((35, 72), (-70, 80), (180, 72), (20, 42), (0, 85))


def row(kind: Kind, variant: int) -> tuple[np.ndarray, str]:
    """Return the pictures (n, 128, 128, 3) of one variant, and a line about it."""
    shape = assemble(kind.make(np.random.default_rng(variant)))
    thing, rng = drawable(shape), np.random.default_rng(variant)
    colour, second = COLOURS[variant % len(COLOURS)], COLOURS[(variant * 5 + 4) % len(COLOURS)]
    material = MATERIALS[list(MATERIALS)[variant % len(MATERIALS)]]
    looks = [(Look(), a, p) for a, p in _VIEWS]
    looks += [(Look(colour), 35, 72), (Look(colour, material=material), -40, 72)]
    looks += [(Look(colour, parts={r: second}), 35, 72) for r in list(kind.said)[:3]]
    while len(looks) < 10:
        looks.append((Look(second, material=MATERIALS["lego"]), 35, 60))
    pictures = []
    for look, azimuth, polar in looks[:10]:
        camera = orbit_camera(np.radians(azimuth), np.radians(polar), 2.5, np.radians(37))
        pictures.append(
            render(thing, dress(rng, kind, shape, look), camera, 128, np.full(3, 0.82, np.float32))
        )
    return np.stack(
        pictures
    ), f"{kind.words[0]} {variant}: {len(shape.faces)} faces; {colour}, {second} parts"


def decoded(pictures: np.ndarray) -> np.ndarray:
    """Return pictures (n, 128, 128, 3) after the bundled autoencoder."""
    from pipeline.diffusion.sessions import vae_decoder, vae_encoder

    bundle = Path("onnx_models/everyday-objects")
    with vae_encoder(bundle / "vae_encoder") as encode, vae_decoder(bundle / "vae_decoder") as decode:
        return decode(encode(pictures))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("package", help="a folder of makers/")
    parser.add_argument("kinds", nargs="*", help="all of them where none is named")
    parser.add_argument("--variants", type=int, default=4)
    parser.add_argument("--decoded", action="store_true")
    options = parser.parse_args()
    lines = []
    for kind in importlib.import_module(f"export.everyday_objects.data.makers.{options.package}").KINDS:
        if options.kinds and kind.words[0] not in options.kinds:
            continue
        for variant in range(min(options.variants, kind.variants)):
            pictures, text = row(kind, variant)
            pictures = decoded(pictures) if options.decoded else pictures
            line = Image.fromarray(np.round(np.concatenate(list(pictures), 1) * 255).astype(np.uint8))
            ImageDraw.Draw(line).text((3, 2), text, fill=(0, 0, 0))
            lines.append(np.asarray(line))
    Image.fromarray(np.concatenate(lines)).save(options.out)


if __name__ == "__main__":
    main()
