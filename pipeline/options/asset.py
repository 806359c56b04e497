"""The options of the stages that turn a field into an asset: mesh, texture coordinates, texture, pictures."""

from dataclasses import dataclass
from typing import Literal

from pipeline.options.schema import check, check_power_of_two, option


@dataclass(frozen=True)
class Extract:
    """Marching cubes of the density."""

    resolution: int = option(128, "samples along the longest side of the occupied part", 16, 1024)
    views: int = option(24, "views whose silhouettes choose the density threshold", 4, 256)
    # Three trainings on ideal denoisers: normals are off by 19.7 degrees at 0, 17.6 at 1, 16.9 at 1.5, the
    # surface by 0.0093, 0.0088 and 0.0088 scene units. Real trainings are rougher.
    smoothing: float = option(
        1.5,
        "blur of the log density [cells], which takes the grain off the surface; left out where thin parts "
        "would go",
        0,
        5,
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class Clean:
    """Repair and simplification of the mesh."""

    faces: int = option(20_000, "face budget", 100, 5_000_000)
    smoothing: int = option(15, "Taubin smoothing steps", 0, 100)
    # What it is worth on known scenes: make bench ONLY=asset.
    denoise: float = option(
        0.12, "reach of the diffusion of normals, which stops at edges [scene units]; 0: none", 0, 1
    )
    min_component: float = option(0.02, "components with a smaller share of the faces are dropped", 0, 1)

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class Unwrap:
    """Texture coordinates."""

    resolution: int = option(1024, "side of the atlas that islands are packed for [texels]", 64, 16_384)
    padding: int = option(8, "space between islands [texels]", 0, 64)

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class Bake:
    """Decoded views projected onto the texture."""

    views: int = option(24, "views decoded and projected", 4, 256)
    # Of an armchair and a duck 10 views cost 0.5 dB against decoded views that were not used (30.3 and 33.3
    # dB with 24). Ten that were chosen for what they show were 0.3 and 0.7 dB worse than ten spread evenly.
    large_views: int = option(
        10,
        "instead, where a decoded picture has 512 pixels or more a side and takes a third of a minute",
        4,
        256,
    )
    view_resolution: int = option(
        0, "side of a rendered view [latent pixels]; 0: the bundle's latent size, doubled up to 64", 0, 512
    )
    texture: int = option(1024, "side of the texture [texels], a power of two", 64, 8192)
    normal_map: bool = option(True, "a normal map of what the surface was before its faces were made fewer")

    def __post_init__(self) -> None:
        check(self)
        check_power_of_two("bake.texture", self.texture)


@dataclass(frozen=True)
class Publish:
    """The asset and its pictures."""

    unlit: bool = option(False, "show the texture as it is, without light, instead of a lit material")
    pivot: Literal["base", "centre"] = option(
        "base", "the asset's origin: the middle of its bottom, so that it stands on the floor, or its middle"
    )
    size_m: float = option(
        0.0, "longest side of the asset [metres]; 0: as trained, 1.5 m from end to end or less", 0, 10_000
    )
    preview_size: int = option(256, "side of a tile of preview.png [pixels]", 32, 2048)
    turntable_size: int = option(384, "side of the turntable [pixels]", 32, 2048)
    turntable_frames: int = option(72, "frames of one turn", 2, 1000)

    def __post_init__(self) -> None:
        check(self)
