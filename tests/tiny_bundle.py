"""A bundle small enough for every test, made in a fraction of a second, with graphs that do something real.

`write_tiny_bundle(folder)` writes a whole Optimum-layout bundle:
- text encoder: token embedding + position, layer norm (random weights, seeded);
- UNet: the *ideal denoiser* of Gaussian images N(mu, S^2 I), where mu is a soft disc in the middle whose
  colour depends a little on the text. So score distillation has a known answer: every view becomes that
  disc, a scene becomes a ball;
- VAE decoder and encoder: the linear map RGB = A z + b on 4 x 4 pixel blocks and its pseudo-inverse;
- a byte-pair tokenizer in CLIP's format, trained on a few captions.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import numpy_helper

from export.bundle_files import train_tokenizer, write_bundle_json, write_configs, write_json

WIDTH = 16
"""Text width."""
FACTOR = 4
"""Image pixels a latent pixel."""
SCALE = 0.5
"""Latent scale."""
VOCABULARY = 600
"""Rows of the text encoder's table; the tokenizer fills fewer."""
WINDOW = 32
"""Tokens a text."""
SPREAD = 0.3
"""Standard deviation of the Gaussian images, scaled latents."""
DISC = np.array([1.0, -0.5, 0.8, 0.2], np.float32)
"""Colour of the disc before the text's part, scaled latents."""
LATENT_TO_RGB = np.array([[0.3, 0.1, 0.1, 0.0], [0.1, -0.3, 0.1, 0.1], [0.0, 0.1, 0.3, -0.1]], np.float32)
"""A: RGB in [0, 1] from unscaled latents."""
RGB_BIAS = np.array([0.5, 0.5, 0.5], np.float32)
CAPTIONS = [
    f"a {colour} {noun}, {overhead}{view} view"
    for colour in ("red", "green", "blue", "white")
    for noun in ("ball", "armchair", "donut", "mug")
    for view in (
        "front",
        "front left",
        "left side",
        "back left",
        "back",
        "back right",
        "right side",
        "front right",
    )
    for overhead in ("", "overhead ")
]
SCHEDULER = {
    "num_train_timesteps": 1000,
    "beta_schedule": "scaled_linear",
    "beta_start": 0.00085,
    "beta_end": 0.012,
    "prediction_type": "v_prediction",
}


def alphas_cumprod() -> np.ndarray:
    """Return abar of SCHEDULER, (1000,) float64, independently of the code under test."""
    betas = np.linspace(0.00085**0.5, 0.012**0.5, 1000) ** 2
    return np.cumprod(1 - betas)


def disc(size: int) -> np.ndarray:
    """Return the soft disc of the ideal denoiser, (size, size) in [0, 1], radius a quarter of the image."""
    axis = (np.arange(size) + 0.5) / size * 2 - 1
    radius = np.hypot(axis[:, None], axis[None, :])
    return (1 / (1 + np.exp((radius - 0.5) * 20))).astype(np.float32)


def save_graph(folder: Path, text: str, constants: dict[str, Any]) -> Path:
    """Write the graph in onnx's text form, with `constants` as initializers, to folder/model.onnx."""
    model = onnx.parser.parse_model(f'<ir_version: 9, opset_import: ["": 20]>\n{text}')
    model.graph.initializer.extend(numpy_helper.from_array(np.asarray(v), k) for k, v in constants.items())
    onnx.checker.check_model(model)
    folder.mkdir(parents=True, exist_ok=True)
    onnx.save(model, folder / "model.onnx")
    return folder / "model.onnx"


def write_text_encoder(
    folder: Path, vocabulary: int, ids: str = "int64", seed: int = 0, learned_tokens: bool = False
) -> None:
    """Write the text encoder; `ids` is the type of input_ids, `learned_tokens` adds their input."""
    random = np.random.default_rng(seed)
    extra, table = (
        f", float[extra, {WIDTH}] token_embeddings",
        "Concat<axis = 0>(embedding, token_embeddings)",
    )
    save_graph(
        folder,
        f"""
        text_encoder ({ids}[batch, length] input_ids{extra if learned_tokens else ""})
            => (float[batch, length, {WIDTH}] last_hidden_state)
        {{
            table = {table if learned_tokens else "Identity(embedding)"}
            tokens = Gather(table, input_ids)
            shape = Shape<start = 1, end = 2>(input_ids)
            here = Slice(position, zero, shape)
            placed = Add(tokens, here)
            last_hidden_state = LayerNormalization<axis = -1>(placed, gain)
        }}""",
        {
            "embedding": random.normal(size=(vocabulary, WIDTH)).astype(np.float32),
            "position": random.normal(size=(512, WIDTH)).astype(np.float32),
            "gain": np.ones(WIDTH, np.float32),
            "zero": np.zeros(1, np.int64),
        },
    )


def write_unet(
    folder: Path,
    *,
    prediction: str = "v_prediction",
    timestep: str = "int64[batch]",
    sample: str = "float[batch, 4, height, width]",
    seed: int = 0,
) -> None:
    """Write the ideal denoiser.

    `prediction`: "v_prediction", "epsilon" or "sample". `timestep`, `sample`: type and shape of these
    inputs in onnx's text form (`int64`, `float[1]`, `float16[2, 4, 16, 16]`, ...); the text input has
    the type of the sample.
    """
    random = np.random.default_rng(seed)
    kind = sample.split("[")[0]
    output = {
        "v_prediction": "scaled = Mul(root, noisy)  rest = Sub(scaled, clean)  result = Div(rest, sigma)",
        "epsilon": "scaled = Mul(root, clean)  rest = Sub(noisy, scaled)  result = Div(rest, sigma)",
        "sample": "result = Identity(clean)",
    }[prediction]
    code = {"float": 1, "float16": 10, "double": 11}[kind]
    save_graph(
        folder,
        f"""
        unet ({sample} sample, {timestep} timestep, {kind}[batch, length, {WIDTH}] encoder_hidden_states)
            => ({sample} out_sample)
        {{
            noisy = Cast<to = 1>(sample)
            text = Cast<to = 1>(encoder_hidden_states)
            index = Cast<to = 7>(timestep)
            row = Reshape(index, minus_one)
            level = Gather(alphas, row)
            alpha = Reshape(level, column)
            root = Sqrt(alpha)
            noise_power = Sub(one, alpha)
            sigma = Sqrt(noise_power)
            pooled = ReduceMean<keepdims = 0>(text, axis)
            said = MatMul(pooled, text_to_latent)
            tint = Add(said, colour)
            flat = Reshape(tint, colours)
            size = Shape<start = 2>(sample)
            sizes = Concat<axis = 0>(ones, size)
            picture = Resize<mode = "linear">(disc, , , sizes)
            mean = Mul(flat, picture)
            signal_power = Mul(alpha, variance)
            power = Add(signal_power, noise_power)
            part = Mul(root, variance)
            gain = Div(part, power)
            expected = Mul(root, mean)
            surprise = Sub(noisy, expected)
            correction = Mul(gain, surprise)
            clean = Add(mean, correction)
            {output}
            out_sample = Cast<to = {code}>(result)
        }}""",
        {
            "alphas": alphas_cumprod().astype(np.float32),
            "disc": disc(64)[None, None],
            "colour": DISC,
            "text_to_latent": 0.3 * random.normal(size=(WIDTH, 4)).astype(np.float32),
            "variance": np.float32(SPREAD**2),
            "one": np.float32(1),
            "ones": np.ones(2, np.int64),
            "minus_one": np.array([-1]),
            "column": np.array([-1, 1, 1, 1]),
            "colours": np.array([-1, 4, 1, 1]),
            "axis": np.array([1]),
        },
    )


def write_vae(decoder: Path, encoder: Path, *, moments: bool = True) -> None:
    """Write the linear decoder and encoder; `moments`: mean and log-variance (8 channels)."""
    save_graph(
        decoder,
        """
        vae_decoder (float[batch, 4, height, width] latent_sample) => (float[batch, 3, H, W] sample)
        {
            small = Conv(latent_sample, weight, bias)
            sample = Resize<mode = "nearest">(small, , scales)
        }""",
        {
            "weight": (2 * LATENT_TO_RGB)[:, :, None, None],
            "bias": 2 * RGB_BIAS - 1,
            "scales": np.array([1, 1, FACTOR, FACTOR], np.float32),
        },
    )
    inverse = np.linalg.pinv(2 * LATENT_TO_RGB.astype(np.float64))
    name, channels = ("latent_parameters", 8) if moments else ("latent_sample", 4)
    weight = np.zeros((channels, 3), np.float64)
    weight[:4] = inverse
    bias = np.full(channels, -10.0)
    bias[:4] = -inverse @ (2 * RGB_BIAS - 1)
    save_graph(
        encoder,
        f"""
        vae_encoder (float[batch, 3, H, W] sample) => (float[batch, {channels}, height, width] {name})
        {{
            small = AveragePool<kernel_shape = [{FACTOR}, {FACTOR}], strides = [{FACTOR}, {FACTOR}]>(sample)
            {name} = Conv(small, weight, bias)
        }}""",
        {"weight": weight[:, :, None, None].astype(np.float32), "bias": bias.astype(np.float32)},
    )


def write_encoder_vjp(folder: Path) -> None:
    """Write the input gradient of the linear encoder: every pixel of a block gets a share of the latent's."""
    inverse = np.linalg.pinv(2 * LATENT_TO_RGB.astype(np.float64))
    save_graph(
        folder,
        """
        vae_encoder_vjp (float[1, 3, H, W] sample, float[1, 4, height, width] cotangent)
            => (float[1, 3, H, W] gradient)
        {
            small = Conv(cotangent, weight)
            gradient = Resize<mode = "nearest">(small, , scales)
            nothing = Identity(sample)
        }""",
        {
            "weight": (inverse.T / FACTOR**2)[:, :, None, None].astype(np.float32),
            "scales": np.array([1, 1, FACTOR, FACTOR], np.float32),
        },
    )


def write_tiny_bundle(
    folder: Path,
    *,
    latent_size: int = 16,
    prediction: str = "v_prediction",
    timestep: str = "int64[batch]",
    distillation: dict[str, Any] | None = None,
    encoder_vjp: bool = False,
    learned_tokens: bool = False,
) -> Path:
    """Write the whole bundle and return its folder. `latent_size`: of training, pixels (images: 4 times);
    `encoder_vjp`: with the encoder's input gradient; `learned_tokens`: that its text encoder takes."""
    train_tokenizer(folder / "tokenizer", CAPTIONS, vocabulary_size=VOCABULARY, max_length=WINDOW)
    write_text_encoder(folder / "text_encoder", vocabulary=VOCABULARY, learned_tokens=learned_tokens)
    write_unet(folder / "unet", prediction=prediction, timestep=timestep)
    write_vae(folder / "vae_decoder", folder / "vae_encoder")
    if encoder_vjp:
        write_encoder_vjp(folder / "vae_encoder_vjp")
    write_configs(
        folder,
        latent_size=latent_size,
        latent_channels=4,
        latent_scale=SCALE,
        downsampling=FACTOR,
        scheduler={**SCHEDULER, "prediction_type": prediction},
    )
    write_json(
        folder / "text_encoder" / "config.json", {"_class_name": "CLIPTextModel", "vocab_size": VOCABULARY}
    )
    words = {word for caption in CAPTIONS for word in caption.replace(",", "").split()}
    description = {
        "name": folder.name,
        "image_size": latent_size * FACTOR,
        "latent_size": latent_size,
        "latent_channels": 4,
        "latent_scale": SCALE,
        "view_prompts": "eight",
        "known_words": sorted(words),
        # bundle.json maps *scaled* latents, as the scene holds them, to RGB in [-1, 1].
        "latent_to_rgb": (2 * LATENT_TO_RGB / SCALE).tolist(),
        "latent_to_rgb_bias": (2 * RGB_BIAS - 1).tolist(),
        "distillation": distillation or {},
        "trained_on": "nothing; the ideal denoiser of a disc",
    }
    write_bundle_json(folder, description)
    return folder
