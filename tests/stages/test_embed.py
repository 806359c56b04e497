"""Stage embed on the tiny bundle: rows, backgrounds, warnings, equal bytes."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from pipeline.diffusion.onnx_file import read_onnx
from pipeline.diffusion.sessions import text_encoder, vae_decoder
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.errors import InputError
from pipeline.options.job import Job
from pipeline.run.stage import Context
from pipeline.stages.embed import embed_texts, flat_latents, main, prepare_texts
from pipeline.training.flat_colours import flat_colours
from tests.tiny_bundle import SCALE, WIDTH, WINDOW, save_graph, write_tiny_bundle


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_bundle(tmp_path_factory.mktemp("models") / "tiny")


def context(bundle: Path, folder: Path, prompt: str, negative: str = "", encoder: bool = True) -> Context:
    folder.mkdir(parents=True, exist_ok=True)
    names = ["text_encoder", "tokenizer", *(["vae_encoder"] if encoder else [])]
    return Context(
        job=Job(prompt=prompt, negative=negative),
        inputs={name: bundle / name for name in names},
        outputs={"embeddings": folder / "embeddings.npz"},
        scratch=folder,
        metrics={},
    )


def run(
    bundle: Path, folder: Path, prompt: str, negative: str = ""
) -> tuple[dict[str, np.ndarray], list[str]]:
    made = context(bundle, folder, prompt, negative)
    main(made)
    with np.load(folder / "embeddings.npz", allow_pickle=False) as file:
        return dict(file), made.metrics["warnings"]


def test_every_view_has_its_row_and_the_negative_prompt_is_the_unconditional_one(
    bundle: Path, tmp_path: Path
) -> None:
    arrays, warnings = run(bundle, tmp_path, "a red armchair", negative="blue")
    assert warnings == []
    assert arrays["cond"].shape == (16, WINDOW, WIDTH)
    assert arrays["uncond"].shape == (WINDOW, WIDTH)
    assert arrays["cond"].dtype == arrays["uncond"].dtype == np.float32
    assert arrays["view_texts"][3] == "a red armchair, back left view"
    assert str(arrays["view_prompts"]) == "eight"
    tokenizer = load_tokenizer(bundle / "tokenizer")
    with text_encoder(bundle / "text_encoder") as encode_text:
        for row, text in zip(
            [*arrays["cond"], arrays["uncond"]], [*arrays["view_texts"], "blue"], strict=True
        ):
            assert np.array_equal(row, encode_text(tokenizer.encode(str(text))[None])[0])
    assert len(np.unique(arrays["cond"].reshape(16, -1), axis=0)) == 16


def test_backgrounds_are_the_latents_of_their_colours(bundle: Path, tmp_path: Path) -> None:
    arrays, _ = run(bundle, tmp_path, "a red ball")
    assert arrays["backgrounds"].shape == (64, 4)
    assert arrays["background_rgb"].shape == (64, 3)
    assert {(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)} <= set(map(tuple, arrays["background_rgb"].tolist()))
    with vae_decoder(bundle / "vae_decoder") as decode:
        images = decode(arrays["backgrounds"][:, :, None, None])
    np.testing.assert_allclose(images.mean((1, 2)), arrays["background_rgb"], atol=1e-5)


def test_without_a_vae_encoder_there_are_no_backgrounds(bundle: Path, tmp_path: Path) -> None:
    main(context(bundle, tmp_path, "a red ball", encoder=False))
    with np.load(tmp_path / "embeddings.npz") as file:
        assert sorted(file.files) == ["cond", "uncond", "view_prompts", "view_texts"]


def test_equal_jobs_give_equal_bytes(bundle: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        main(context(bundle, tmp_path / name, "a blue mug"))
    assert (tmp_path / "a/embeddings.npz").read_bytes() == (tmp_path / "b/embeddings.npz").read_bytes()


def test_a_long_prompt_warns_with_what_was_cut_and_keeps_the_view_words(bundle: Path, tmp_path: Path) -> None:
    prompt = "a red armchair " * 11 + "a blue donut"
    arrays, warnings = run(bundle, tmp_path, prompt)
    assert len(warnings) == 1
    assert f"window of {WINDOW} tokens" in warnings[0]
    assert warnings[0].endswith("a blue donut")
    assert all(text.endswith(" view") for text in arrays["view_texts"])
    assert "donut" not in arrays["view_texts"][0]
    assert len(np.unique(arrays["cond"].reshape(16, -1), axis=0)) == 16


def test_unknown_words_are_named_and_long_warnings_stay_readable(bundle: Path, tmp_path: Path) -> None:
    _, warnings = run(bundle, tmp_path, "a red zorblax", negative="qwerty")
    assert len(warnings) == 1
    assert "zorblax, qwerty" in warnings[0]
    _, warnings = run(bundle, tmp_path, "zorblax " * 3000, negative="wobble " * 3000)
    assert [len(warning) < 500 for warning in warnings] == [True] * 3
    assert "negative prompt" in warnings[1]
    assert "\n" not in "".join(warnings)


def test_equal_texts_are_encoded_once(bundle: Path) -> None:
    tokenizer = load_tokenizer(bundle / "tokenizer")
    calls = []

    def encode_text(ids: np.ndarray) -> np.ndarray:
        calls.append(ids)
        return np.full((*ids.shape, 2), float(len(calls)), np.float32)

    rows = embed_texts(["a", "b", "a"], tokenizer, encode_text)
    assert len(calls) == 2
    assert rows[:, 0, 0].tolist() == [1, 2, 1]


def test_texts_of_a_model_that_knows_every_word(bundle: Path) -> None:
    tokenizer = load_tokenizer(bundle / "tokenizer")
    texts = prepare_texts(" a zorblax \n", "", tokenizer, "paper", None)
    assert texts.views[0] == "a zorblax, front view"
    assert (len(texts.views), texts.negative, texts.warnings) == (5, "", [])


def test_the_border_of_an_encoded_colour_is_left_out() -> None:
    def encode(images: np.ndarray) -> np.ndarray:
        latents = np.full((1, 4, 8, 8), 100, np.float32)  # a border tinted by zero padding
        latents[:, :, 2:6, 2:6] = images.mean()
        return latents

    colours = flat_colours()[[0, 21, 63]]
    np.testing.assert_allclose(flat_latents(encode, colours, 32)[:, 0], colours.mean(1), atol=1e-6)


def test_backgrounds_follow_a_fixed_size_graph(bundle: Path, tmp_path: Path) -> None:
    other = write_tiny_bundle(tmp_path / "other")
    save_graph(
        other / "vae_encoder",
        """vae_encoder (float[1, 3, 24, 24] sample) => (float[1, 4, 6, 6] latent_sample)
        {
            small = AveragePool<kernel_shape = [4, 4], strides = [4, 4]>(sample)
            latent_sample = Conv(small, weight)
        }""",
        {"weight": np.eye(4, 3, dtype=np.float32)[:, :, None, None]},
    )
    assert read_onnx(other / "vae_encoder" / "model.onnx").inputs["sample"].shape == (1, 3, 24, 24)
    arrays, _ = run(other, tmp_path / "run", "a red ball")
    np.testing.assert_allclose(
        arrays["backgrounds"][:, :3], SCALE * (2 * arrays["background_rgb"] - 1), atol=1e-5
    )


def with_token(bundle: Path, folder: Path, prompt: str, **more: object) -> Context:
    made = context(bundle, folder, prompt)
    save_file({"<cat>": torch.from_numpy(np.full((2, WIDTH), 0.5, np.float32))}, folder / "cat.safetensors")
    return dataclasses.replace(made, inputs={**made.inputs, "token0": folder / "cat.safetensors"}, **more)


def test_a_learned_token_stands_in_every_view(tmp_path: Path) -> None:
    bundle = write_tiny_bundle(tmp_path / "model", learned_tokens=True)
    made = with_token(bundle, tmp_path / "with", "a red <cat>")
    main(made)
    with np.load(made.outputs["embeddings"]) as file:
        rows, texts = file["cond"], file["view_texts"]
    assert texts[0] == "a red *, front view"
    assert made.metrics == {"tokens": {"cat.safetensors": 2}, "warnings": []}
    plain, _ = run(bundle, tmp_path / "without", "a red ball")
    assert np.abs(rows - plain["cond"]).max() > 0.1
    np.testing.assert_array_equal(rows[:, :3], plain["cond"][:, :3])  # begin, "a", "red" come before it


def test_a_model_that_takes_no_tokens_says_what_to_do(bundle: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"token_embeddings.* export the model again"):
        main(with_token(bundle, tmp_path, "a red <cat>"))


def test_embedding_starts_without_torch():
    code = "import sys, pipeline.stages.embed; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
