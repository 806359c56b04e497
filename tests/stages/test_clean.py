import numpy as np
import pytest
import trimesh

from pipeline.mesh.mesh import Mesh, vertex_normals
from pipeline.mesh.silhouettes import comparison_cameras, mean_iou, silhouettes
from pipeline.mesh.topology import face_components, signed_volumes, topology
from pipeline.stages.clean import clean_mesh, remove_cavities, remove_floaters
from tests import shapes


def names(steps: list[dict]) -> list[str]:
    return [step["step"] for step in steps]


def test_chair_stays_whole_within_the_budget() -> None:
    raw = shapes.mesh_of(shapes.chair(), 96)
    assert len(raw.faces) > 4000
    mesh, _, steps = clean_mesh(raw, 2000, 5, 0.02)
    assert len(mesh.faces) <= 2000
    counts = topology(mesh)
    assert counts.manifold
    assert counts.closed
    assert counts.components == 1
    independent = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert independent.is_watertight
    assert independent.is_winding_consistent
    assert independent.volume > 0
    cameras = comparison_cameras(12)
    assert mean_iou(silhouettes(mesh, cameras, 128), silhouettes(raw, cameras, 128)) > 0.96
    for x in (-1, 1):
        for z in (-1, 1):
            foot = np.abs(mesh.vertices - [0.3 * x, -0.55, 0.3 * z]).max(axis=1)
            assert foot.min() < 0.05, "a leg was lost"
    assert steps[0]["faces"] == len(raw.faces)
    assert steps[-1]["faces"] == len(mesh.faces)
    assert "decimation" in names(steps)


def test_floaters_go_and_large_parts_stay() -> None:
    solid = shapes.union(
        shapes.ball(0.4, (-0.4, 0, 0)), shapes.ball(0.25, (0.6, 0, 0)), shapes.ball(0.06, (0.3, 0.8, 0))
    )
    raw = shapes.mesh_of(solid, 48)
    assert topology(raw).components == 3
    mesh, _, steps = clean_mesh(raw, 100_000, 0, 0.05)
    assert topology(mesh).components == 2
    assert mesh.vertices[:, 1].max() < 0.5
    floaters = next(step for step in steps if step["step"] == "floaters")
    assert floaters["components"] == 2


def test_a_foot_cut_off_its_leg_is_no_floater() -> None:
    """The same small ball stays near the body, and near another such fragment, and goes when it is far
    away.
    """
    body = shapes.box((0.3, 0.3, 0.3), (0, 0.4, 0))
    chain = [shapes.ball(0.05, (0, y, 0)) for y in (0.0, -0.13)]
    raw = shapes.mesh_of(shapes.union(body, *chain, shapes.ball(0.05, (0, -0.7, 0))), 64)
    assert topology(raw).components == 4
    kept = remove_floaters(raw, 0.1)
    assert topology(kept).components == 3
    assert -0.2 < kept.vertices[:, 1].min() < -0.1


def test_the_largest_piece_stays_whatever_the_share() -> None:
    raw = shapes.mesh_of(shapes.union(shapes.ball(0.4, (-0.5, 0, 0)), shapes.ball(0.1, (0.8, 0, 0))), 32)
    assert topology(remove_floaters(raw, 1.0)).components == 1


def test_a_hollow_loses_its_inner_wall() -> None:
    raw = shapes.mesh_of(shapes.hollow(shapes.ball(0.6), shapes.ball(0.3)), 32)
    assert sorted(np.sign(signed_volumes(raw, face_components(raw)))) == [-1, 1]
    mesh = remove_cavities(raw)
    assert signed_volumes(mesh, face_components(mesh)) == pytest.approx([4 / 3 * np.pi * 0.6**3], rel=0.02)


def test_a_mesh_inside_out_is_turned_and_keeps_its_pieces() -> None:
    raw = shapes.mesh_of(shapes.ball(0.5), 24)
    mesh, *_ = clean_mesh(Mesh(raw.vertices, raw.faces[:, ::-1].copy()), 100_000, 0, 0.02)
    assert signed_volumes(mesh, face_components(mesh))[0] > 0
    assert len(mesh.faces) == len(raw.faces)


def test_broken_meshes_are_repaired() -> None:
    """A hole, repeated faces, a face without area, and an unused vertex."""
    raw = shapes.mesh_of(shapes.ball(0.5), 24)
    faces = np.concatenate([raw.faces[3:], raw.faces[10:20], [[5, 5, 6]]]).astype(np.int32)
    vertices = np.concatenate([raw.vertices, [[9, 9, 9]]]).astype(np.float32)
    mesh, *_ = clean_mesh(Mesh(vertices, faces), 100_000, 0, 0.02)
    counts = topology(mesh)
    assert counts.manifold
    assert counts.closed
    assert counts.euler == 2
    assert np.abs(mesh.vertices).max() < 0.6


def test_an_edge_of_four_faces_is_repaired() -> None:
    first = shapes.mesh_of(shapes.box((0.3, 0.3, 0.3)), 16)
    apart = shapes.mesh_of(shapes.box((0.2, 0.2, 0.2)), 16)
    edge = first.faces[0, :2]
    joined = apart.faces + len(first.vertices)
    a, b = joined[0, :2].copy()
    joined = np.where(joined == a, edge[1], np.where(joined == b, edge[0], joined))
    raw = Mesh(
        np.concatenate([first.vertices, apart.vertices]),
        np.concatenate([first.faces, joined]).astype(np.int32),
    )
    assert topology(raw).non_manifold_edges == 1
    mesh, *_ = clean_mesh(raw, 100_000, 0, 0.0)
    assert topology(mesh).manifold


def test_smoothing_keeps_the_volume_and_removes_the_staircase() -> None:
    raw = shapes.mesh_of(shapes.ball(0.5), 32)
    rng = np.random.default_rng(0)
    noisy = raw._replace(vertices=raw.vertices + rng.normal(0, 0.01, raw.vertices.shape).astype(np.float32))
    mesh, *_ = clean_mesh(noisy, 100_000, 10, 0.02)
    before = np.linalg.norm(noisy.vertices, axis=1).std()
    after = np.linalg.norm(mesh.vertices, axis=1).std()
    assert after < 0.5 * before
    volume = signed_volumes(mesh, face_components(mesh))[0]
    assert volume == pytest.approx(4 / 3 * np.pi * 0.5**3, rel=0.02)


def test_same_input_same_bytes() -> None:
    raw = shapes.mesh_of(shapes.chair(), 64)
    first, second = (clean_mesh(raw, 1500, 5, 0.02)[0] for _ in range(2))
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()


def test_denoised_is_smoother_closed_and_within_the_budget() -> None:
    raw = shapes.mesh_of(shapes.ball(0.5), 64)
    away = raw.vertices / np.linalg.norm(raw.vertices, axis=1, keepdims=True)
    waves = 0.004 * np.sin(70 * raw.vertices).sum(axis=1, keepdims=True)
    noisy = raw._replace(vertices=(raw.vertices + waves * away).astype(np.float32))

    def roughness(mesh: Mesh) -> float:
        outwards = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
        return float(np.degrees(np.arccos(np.clip((vertex_normals(mesh) * outwards).sum(1), -1, 1))).mean())

    plain, smooth = (clean_mesh(noisy, 4000, 5, 0.02, reach=reach) for reach in (0.0, 0.1))
    assert roughness(smooth.mesh) < 0.6 * roughness(plain.mesh)
    assert "denoising" in [step["step"] for step in smooth.steps]
    assert len(smooth.mesh.faces) <= 4000 < len(smooth.fine.faces)
    assert topology(smooth.mesh).closed
    assert topology(smooth.mesh).manifold
