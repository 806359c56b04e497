"""Stage embed: the prompt of every view, and plain backgrounds, in the terms of the network.

Texts are embedded once here, never in a training step. Backgrounds are the latents of flat colours: training
puts the object before a random one, so that no fixed background can hide parts of it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from pipeline.arrays import pack
from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.onnx_file import read_onnx
from pipeline.diffusion.prompts import view_suffixes
from pipeline.diffusion.sessions import Encode, EncodeText, text_encoder, vae_encoder
from pipeline.diffusion.tokenizer import ClipTokenizer, load_tokenizer, unknown_words
from pipeline.diffusion.tokens import insert_tokens, readable, token_table
from pipeline.run.stage import Context, execute
from pipeline.training.flat_colours import flat_colours

BACKGROUND_PIXELS = 128
"""A flat colour needs no more: the encoder of Stable Diffusion at 512 would take minutes for all of them."""


@dataclass(frozen=True)
class Texts:
    """The texts to embed: one a view, the negative one, and what the user should hear about them."""

    views: list[str]
    negative: str
    warnings: list[str]


def prepare_texts(
    prompt: str,
    negative: str,
    tokenizer: ClipTokenizer,
    view_prompts: str,
    known_words: frozenset[str] | None,
) -> Texts:
    """Return the texts of all views, shortened to the model's window with the view words kept."""
    suffixes = view_suffixes(view_prompts)
    warnings = []
    window = f"is longer than the model's window of {tokenizer.length} tokens; cut:"
    prompt, cut = tokenizer.fit(prompt.strip(), suffixes)
    if cut:
        warnings.append(f"the prompt {window} {_shown(readable(cut))}")
    negative, cut = tokenizer.fit(negative.strip())
    if cut:
        warnings.append(f"the negative prompt {window} {_shown(readable(cut))}")
    if unknown := unknown_words(readable(f"{prompt} {negative}"), known_words):
        warnings.append(
            f"the model has never seen these words, expect them to be ignored: {_shown(', '.join(unknown))}"
        )
    return Texts([prompt + suffix for suffix in suffixes], negative, warnings)


def _shown(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= 300 else f"{text[:300]}... ({len(text)} characters)"


def embed_texts(
    texts: Sequence[str], tokenizer: ClipTokenizer, encode_text: EncodeText
) -> Float32[np.ndarray, "v l d"]:
    """Return the text encoder's last hidden states of every text; equal texts are encoded once."""
    distinct = list(dict.fromkeys(texts))
    rows = {text: encode_text(tokenizer.encode(text)[None])[0] for text in distinct}
    return np.stack([rows[text] for text in texts])


def flat_latents(
    encode: Encode, colours: Float32[np.ndarray, "k 3"], size: int
) -> Float32[np.ndarray, "k c"]:
    """Return the latents of flat images of these colours, `size` pixels wide: the mean of the middle half.

    The middle, because an encoder's zero padding tints the border.
    """
    rows = []
    for colour in colours:
        latents = encode(np.broadcast_to(colour, (1, size, size, 3)).astype(np.float32))[0]
        height, width = latents.shape[1:]
        middle = latents[:, height // 4 : height - height // 4, width // 4 : width - width // 4]
        rows.append(middle.mean(axis=(1, 2), dtype=np.float64).astype(np.float32))
    return np.stack(rows)


def _background_size(context: Context, bundle: Bundle) -> int:
    """Return the side of the flat images: what the encoder's graph fixes, else small."""
    port = read_onnx(context.inputs["vae_encoder"] / "model.onnx").inputs.get("sample")
    fixed = port.shape[-1] if port is not None and port.shape else None
    return fixed or min(bundle.image_size, BACKGROUND_PIXELS)


def main(context: Context) -> None:
    """Write embeddings.npz: cond, uncond, view_texts, view_prompts and, with a VAE encoder, backgrounds."""
    bundle = open_bundle(context.inputs["text_encoder"].parent, verify=False)
    tokenizer = load_tokenizer(context.inputs["tokenizer"])
    prompt, negative, learned = context.job.prompt, context.job.negative, None
    if files := [path for name, path in context.inputs.items() if re.fullmatch(r"token\d+", name)]:
        from pipeline.diffusion.token_files import read_token  # imports torch, which takes seconds

        tokens = [read_token(path) for path in files]
        table = token_table(context.inputs["text_encoder"], tokenizer)
        (prompt, negative), tokenizer, learned = insert_tokens(tokens, prompt, [negative], tokenizer, table)
        context.metrics["tokens"] = {file.name: len(t.vectors) for file, t in zip(files, tokens, strict=True)}
    texts = prepare_texts(prompt, negative, tokenizer, bundle.view_prompts, bundle.known_words)
    context.metrics["warnings"] = texts.warnings
    with text_encoder(context.inputs["text_encoder"], learned, context.job.provider) as encode_text:
        rows = embed_texts([*texts.views, texts.negative], tokenizer, encode_text)
    arrays = {
        "cond": rows[:-1],
        "uncond": rows[-1],
        "view_texts": np.array([readable(text) for text in texts.views]),
        "view_prompts": np.array(bundle.view_prompts),
    }
    if "vae_encoder" in context.inputs:
        arrays["background_rgb"] = flat_colours()
        with vae_encoder(context.inputs["vae_encoder"], provider=context.job.provider) as encode:
            arrays["backgrounds"] = flat_latents(encode, flat_colours(), _background_size(context, bundle))
    context.outputs["embeddings"].write_bytes(pack(arrays))


if __name__ == "__main__":
    execute("embed", main)
