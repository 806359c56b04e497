"""Feeds of every type and rank, named outputs, faults inside the network."""

import gc
import weakref
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import numpy_helper

from pipeline.diffusion.graphs import Graph, explain_load_error, open_graph
from pipeline.diffusion.sessions import denoiser, guidance_embedding, text_encoder, vae_decoder, vae_encoder
from pipeline.errors import InputError
from tests.tiny_bundle import (
    DISC,
    FACTOR,
    LATENT_TO_RGB,
    RGB_BIAS,
    SCALE,
    SPREAD,
    WIDTH,
    alphas_cumprod,
    disc,
    save_graph,
    write_text_encoder,
    write_unet,
    write_vae,
)

TIMESTEPS = np.array([20, 500, 20, 979])


def ideal_clean(noisy: np.ndarray, timesteps: np.ndarray) -> np.ndarray:
    """The posterior mean of N(mu, SPREAD^2 I) in float64, without the text's tint (text = 0)."""
    abar = alphas_cumprod()[timesteps].reshape(-1, 1, 1, 1)
    mean = DISC[:, None, None].astype(np.float64) * disc(noisy.shape[-1])
    gain = SPREAD**2 * np.sqrt(abar) / (abar * SPREAD**2 + 1 - abar)
    return mean + gain * (noisy - np.sqrt(abar) * mean)


def noisy_latents(count: int = 4, size: int = 64) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(count, 4, size, size)).astype(np.float32)


@pytest.mark.parametrize(
    "timestep", ["int64[batch]", "float[batch]", "int32", "int64[1]", "float16", "double[batch]"]
)
@pytest.mark.parametrize(
    "sample", ["float[batch, 4, h, w]", "float16[batch, 4, h, w]", "double[batch, 4, h, w]"]
)
def test_the_denoiser_takes_every_kind_of_timestep_and_sample(
    tmp_path: Path, timestep: str, sample: str
) -> None:
    write_unet(tmp_path, prediction="sample", timestep=timestep, sample=sample)
    noisy = noisy_latents()
    with denoiser(tmp_path) as denoise:
        clean = denoise(noisy, TIMESTEPS, np.zeros((4, 3, WIDTH), np.float32))
    assert clean.dtype == np.float32
    tolerance = 4e-3 if "float16" in sample else 1e-5
    np.testing.assert_allclose(clean, ideal_clean(noisy, TIMESTEPS), atol=tolerance)


@pytest.mark.parametrize("fixed", [1, 2, 3, 8])
@pytest.mark.parametrize("timestep", ["int64", "float[fixed]"])
def test_a_fixed_batch_is_served_in_blocks(tmp_path: Path, fixed: int, timestep: str) -> None:
    kind = timestep.replace("fixed", str(fixed))
    write_unet(tmp_path, prediction="sample", timestep=kind, sample=f"float[{fixed}, 4, 64, 64]")
    noisy = noisy_latents()
    with denoiser(tmp_path) as denoise:
        clean = denoise(noisy, TIMESTEPS, np.zeros((4, 3, WIDTH), np.float32))
    np.testing.assert_allclose(clean, ideal_clean(noisy, TIMESTEPS), atol=1e-5)


def test_every_row_has_its_own_text(tmp_path: Path) -> None:
    write_unet(tmp_path, prediction="sample", timestep="int64")
    text = np.random.default_rng(0).normal(size=(3, 5, WIDTH)).astype(np.float32)
    noisy, timesteps = noisy_latents(3, 8), np.array([10, 900, 10])
    with denoiser(tmp_path) as denoise:
        together = denoise(noisy, timesteps, text)
        alone = [denoise(noisy[i : i + 1], timesteps[i : i + 1], text[i : i + 1])[0] for i in range(3)]
    np.testing.assert_allclose(together, alone, atol=1e-6)
    assert np.abs(together[0] - together[2]).max() > 0.1


@pytest.mark.parametrize(("threads", "expected", "runs"), [(2, 8, 2), (2, 7, 1), (3, 12, 3), (1, 8, 1)])
def test_threads_share_the_rows_where_each_gets_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threads: int, expected: int, runs: int
) -> None:
    write_unet(tmp_path, prediction="sample", timestep="int64[batch]")
    text = np.random.default_rng(0).normal(size=(9, 5, WIDTH)).astype(np.float32)
    noisy, timesteps = noisy_latents(9, 8), np.arange(9) * 100
    with denoiser(tmp_path, 1) as denoise:
        one = denoise(noisy, timesteps, text)
    rows: list[int] = []
    run = Graph.run

    def counted(self: Graph, feeds: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        rows.append(len(feeds["sample"]))
        return run(self, feeds)

    monkeypatch.setattr(Graph, "run", counted)
    with denoiser(tmp_path, threads, rows_expected=expected) as denoise:
        shared = denoise(noisy, timesteps, text)
    assert sorted(rows, reverse=True) == [len(part) for part in np.array_split(np.arange(9), runs)]
    np.testing.assert_allclose(shared, one, atol=1e-6)


def write_camera_unet(folder: Path) -> None:
    """A denoiser that multiplies each row by the mean of its camera."""
    save_graph(
        folder,
        f"""
        unet (float[batch, 4, h, w] sample, int64[batch] timestep,
              float[batch, l, {WIDTH}] encoder_hidden_states, float[batch, 3] camera)
            => (float[batch, 4, h, w] out_sample)
        {{
            mean = ReduceMean(camera, one)
            factor = Reshape(mean, shape)
            out_sample = Mul(sample, factor)
        }}""",
        {"one": np.array([1]), "shape": np.array([-1, 1, 1, 1])},
    )


@pytest.mark.parametrize(("threads", "views"), [(1, 1), (2, 1), (2, 4), (3, 4)])
def test_rows_are_told_their_cameras_and_views_are_never_parted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threads: int, views: int
) -> None:
    write_camera_unet(tmp_path)
    noisy, text = noisy_latents(12, 8), np.zeros((12, 5, WIDTH), np.float32)
    cameras = np.repeat(np.arange(12, dtype=np.float32)[:, None], 3, axis=1)
    rows: list[int] = []
    run = Graph.run

    def counted(self: Graph, feeds: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        rows.append(len(feeds["sample"]))
        return run(self, feeds)

    monkeypatch.setattr(Graph, "run", counted)
    with denoiser(tmp_path, threads, rows_expected=12, views=views) as denoise:
        told = denoise(noisy, np.full(12, 5), text, cameras)
        untold = denoise(noisy, np.full(12, 5), text)
    np.testing.assert_allclose(told, noisy * np.arange(12)[:, None, None, None], rtol=1e-6)
    assert not untold.any()
    assert all(count % views == 0 for count in rows)
    assert sum(rows) == 24


def test_a_graph_without_camera_is_asked_as_before(tmp_path: Path) -> None:
    write_unet(tmp_path, prediction="sample", timestep="int64[batch]")
    noisy, text = noisy_latents(4, 8), np.zeros((4, 5, WIDTH), np.float32)
    with denoiser(tmp_path) as denoise:
        plain = denoise(noisy, TIMESTEPS, text)
        np.testing.assert_array_equal(denoise(noisy, TIMESTEPS, text, np.ones((4, 10), np.float32)), plain)


def test_a_size_that_the_graph_fixes_is_an_error_with_both_sizes(tmp_path: Path) -> None:
    write_unet(tmp_path, sample="float[batch, 4, 64, 64]")
    with (
        denoiser(tmp_path) as denoise,
        pytest.raises(InputError, match="fixed to 64 on axis 2, here it is 32"),
    ):
        denoise(noisy_latents(1, 32), TIMESTEPS[:1], np.zeros((1, 3, WIDTH), np.float32))


@pytest.mark.parametrize("ids", ["int64", "int32"])
def test_the_text_encoder_takes_either_integer(tmp_path: Path, ids: str) -> None:
    write_text_encoder(tmp_path, vocabulary=50, ids=ids)
    with text_encoder(tmp_path) as encode_text:
        rows = encode_text(np.array([[1, 2, 3], [3, 2, 49]]))
    assert rows.shape == (2, 3, WIDTH)
    np.testing.assert_allclose(rows.mean(-1), 0, atol=1e-6)  # layer norm
    np.testing.assert_allclose(rows.std(-1), 1, atol=1e-4)
    assert np.array_equal(rows[0, 1], rows[1, 1])


def test_inputs_that_the_graph_lacks_are_dropped_and_strange_ones_are_named(tmp_path: Path) -> None:
    save_graph(
        tmp_path / "plain",
        "g (float[b,4,h,w] sample) => (float[b,4,h,w] out_sample) {out_sample = Neg(sample)}",
        {},
    )
    with denoiser(tmp_path / "plain") as denoise:
        noisy = noisy_latents(2, 8)
        assert np.array_equal(denoise(noisy, TIMESTEPS[:2], np.zeros((2, 3, 5), np.float32)), -noisy)
    save_graph(
        tmp_path / "strange",
        "g (float[b,4,h,w] sample, float[b,4,h,w] mask) => (float[b,4,h,w] y) { y = Mul(sample, mask) }",
        {},
    )
    with denoiser(tmp_path / "strange") as denoise, pytest.raises(InputError, match=r"input.*mask.*export"):
        denoise(noisy, TIMESTEPS[:2], np.zeros((2, 3, 5), np.float32))


def test_the_only_output_of_the_right_rank_is_taken_whatever_its_name(tmp_path: Path) -> None:
    header = "g (float[b,4,h,w] sample) => (float[b,4,h,w] noise, int64[n] extra"
    save_graph(tmp_path / "one", f"{header}) {{ noise = Neg(sample)  extra = Shape(sample) }}", {})
    noisy = noisy_latents(1, 8)
    with denoiser(tmp_path / "one") as denoise:
        assert np.array_equal(denoise(noisy, TIMESTEPS[:1], np.zeros((1, 3, 5), np.float32)), -noisy)
    save_graph(
        tmp_path / "two",
        f"{header}, float[b,4,h,w] z) {{ noise = Neg(sample) extra = Shape(sample) z = Abs(sample) }}",
        {},
    )
    with (
        denoiser(tmp_path / "two") as denoise,
        pytest.raises(InputError, match=r"noise, extra, z.*out_sample"),
    ):
        denoise(noisy, TIMESTEPS[:1], np.zeros((1, 3, 5), np.float32))


def test_an_input_of_unknown_rank_takes_any(tmp_path: Path) -> None:
    text = '<ir_version: 9, opset_import: ["": 20]> g (float[] sample) => (float[] y) { y = Neg(sample) }'
    (tmp_path / "model.onnx").write_bytes(onnx.parser.parse_model(text).SerializeToString())
    with denoiser(tmp_path) as denoise:
        noisy = noisy_latents(2, 8)
        assert np.array_equal(denoise(noisy, TIMESTEPS[:2], np.zeros((2, 3, 5), np.float32)), -noisy)


@pytest.mark.parametrize("moments", [True, False])
@pytest.mark.parametrize("scale", [SCALE, 0.18215])
def test_the_vae_maps_colours_there_and_back(tmp_path: Path, moments: bool, scale: float) -> None:
    write_vae(tmp_path / "decoder", tmp_path / "encoder", moments=moments)
    for name in ("decoder", "encoder"):
        (tmp_path / name / "config.json").write_text(f'{{"scaling_factor": {scale}}}')
    blocks = np.random.default_rng(0).uniform(0.1, 0.9, (2, 3, 5, 3)).astype(np.float32)
    images = blocks.repeat(FACTOR, 1).repeat(FACTOR, 2)
    with vae_encoder(tmp_path / "encoder") as encode, vae_decoder(tmp_path / "decoder") as decode:
        latents = encode(images)
        back = decode(latents)
    assert latents.shape == (2, 4, 3, 5)
    assert back.shape == images.shape
    assert back.dtype == np.float32
    np.testing.assert_allclose(back, images, atol=1e-5)
    # The scale is applied outside the graph: unscaled latents obey the linear map.
    colours = np.einsum("rc,bchw->bhwr", LATENT_TO_RGB, latents / scale) + RGB_BIAS
    np.testing.assert_allclose(colours, blocks, atol=1e-5)


def test_decoded_colours_are_clipped(tmp_path: Path) -> None:
    write_vae(tmp_path / "decoder", tmp_path / "encoder")
    with vae_decoder(tmp_path / "decoder", latent_scale=1.0) as decode:
        image = decode(np.array([0, 100, 0, 0], np.float32).reshape(1, 4, 1, 1))
    assert image.min() == 0
    assert image.max() == 1


@pytest.mark.parametrize(("weight", "said"), [(np.nan, "NaN or infinity"), (1e30, "values up to 1.0e")])
def test_a_damaged_weight_is_caught_with_the_graph_and_the_timestep(
    tmp_path: Path, weight: float, said: str
) -> None:
    write_unet(tmp_path)
    model = onnx.load(tmp_path / "model.onnx")
    colour = next(tensor for tensor in model.graph.initializer if tensor.name == "colour")
    colour.CopyFrom(numpy_helper.from_array(np.array([0, weight, 0, 0], np.float32), "colour"))
    onnx.save(model, tmp_path / "model.onnx")
    with denoiser(tmp_path) as denoise, pytest.raises(InputError) as error:
        denoise(noisy_latents(2, 8), np.array([7, 321]), np.zeros((2, 3, WIDTH), np.float32))
    assert str(tmp_path / "model.onnx") in str(error.value)
    assert said[:12] in str(error.value)
    assert "timestep 7, 321" in str(error.value)


def test_a_diverged_scene_is_not_blamed_on_the_network(tmp_path: Path) -> None:
    write_unet(tmp_path)
    noisy = noisy_latents(1, 8)
    noisy[0, 0, 0, 0] = np.inf
    with denoiser(tmp_path) as denoise, pytest.raises(FloatingPointError, match="before the network"):
        denoise(noisy, np.array([5]), np.zeros((1, 3, WIDTH), np.float32))


def test_the_session_is_released_at_the_end(tmp_path: Path) -> None:
    write_unet(tmp_path)
    with denoiser(tmp_path) as denoise, open_graph(tmp_path) as graph:
        session = weakref.ref(graph.session)
        assert session() is not None
    gc.collect()
    assert session() is None
    with pytest.raises(AttributeError):
        denoise(noisy_latents(1, 8), np.array([5]), np.zeros((1, 3, WIDTH), np.float32))


@pytest.mark.parametrize(
    ("header", "operator", "said"),
    [
        ('["": 20]', "Nonsense(x)", "needs the operator Nonsense"),
        (
            '["": 20, "com.microsoft": 1]',
            "com.microsoft.Nonsense(x)",
            "needs the operator com.microsoft:Nonsense",
        ),
        ('["": 20, "com.microsoft": 1]', "com.microsoft.QMoE(x, x, x, x)", "cannot load it"),
        ('["": 99]', "Relu(x)", "newer than this onnxruntime"),
    ],
)
def test_what_onnxruntime_refuses_becomes_one_plain_line(
    tmp_path: Path, header: str, operator: str, said: str
) -> None:
    text = f"<ir_version: 9, opset_import: {header}>\ng (float[2] x) => (float[2] y) {{ y = {operator} }}"
    (tmp_path / "model.onnx").write_bytes(onnx.parser.parse_model(text).SerializeToString())
    with pytest.raises(InputError) as error, open_graph(tmp_path):
        pass
    assert str(error.value).startswith(f"{tmp_path / 'model.onnx'}: ")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_messages_without_a_pattern_stay_one_line() -> None:
    text = explain_load_error(
        "[ONNXRuntimeError] : 1 : FAIL : Load model from /x/y failed:Odd\nthing " + "z" * 1000
    )
    assert "Odd thing" in text
    assert "/x/y" not in text
    assert len(text) < 400


def test_weights_whose_data_are_short_are_damaged(tmp_path: Path) -> None:
    path = save_graph(
        tmp_path, "g (float[2] x) => (float[2] y) { y = Add(x, w) }", {"w": np.ones(2, np.float32)}
    )
    model = onnx.load(path)
    model.graph.initializer[0].raw_data = b"1234"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(InputError, match="damaged"), open_graph(tmp_path):
        pass


def test_a_latent_consistency_model_is_told_its_guidance() -> None:
    """Sines then cosines of 1000 w over frequencies from 1 to 1 / 10000, as in diffusers' pipeline."""
    row = guidance_embedding(0.5, 8)
    frequencies = 10000.0 ** (-np.arange(4) / 3)
    np.testing.assert_allclose(row[:4], np.sin(500 * frequencies), atol=1e-5)
    np.testing.assert_allclose(row[4:], np.cos(500 * frequencies), atol=1e-5)
