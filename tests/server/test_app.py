"""What visitors and their mistakes meet: real requests to a real server, runs of a tiny model."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import quote

import pytest

from tests.fake_project import ROOT, clean_environment
from tests.server.running import START, Server, serving, write_model

TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
BINARY = {"content_type": "application/octet-stream"}


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    write_model(folder)
    return folder


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("served") / "runs"


@pytest.fixture(scope="module")
def server(out: Path, models: Path) -> Iterator[Server]:
    with serving(out, models) as one:
        yield one


def asked(**more: object) -> dict[str, object]:
    return {"prompt": "a red ball", "quality": "draft", "model": "tiny", **more}


def test_an_asset_is_asked_for_watched_and_downloaded(server: Server, out: Path, models: Path) -> None:
    answer = server.ask("POST", "/api/jobs", asked())
    assert answer.status == 201
    name = answer.json["name"]
    assert answer.json["state"] == "queued"
    job = server.wait(name, "done", "failed")
    assert job["state"] == "done", job["reason"]
    assert [file["name"] for file in job["files"]][:1] == ["asset.glb"]
    got = server.ask("GET", f"/runs/{name}/asset.glb")
    assert (got.status, got.body) == (200, (out / name / "asset.glb").read_bytes())
    named = server.ask("GET", f"/runs/{name}/asset.glb?download")
    assert named.headers["content-disposition"] == f'attachment; filename="{name}-asset.glb"'
    assert server.ask("POST", f"/api/jobs/{name}/verify", {}).json["faults"] == []
    # The same job again is the same, and the command line finds it made.
    again = server.ask("POST", "/api/jobs", asked())
    assert again.json["name"] == name
    server.wait(name, "done")
    assert name.encode() in server.ask("GET", "/runs/").body
    assert [run["name"] for run in server.ask("GET", "/api/jobs").json["runs"]] == [name]
    result = subprocess.run(
        [sys.executable, "-c", START, "run", f"JOB={out / name / 'job.yaml'}", f"OUT={out}", "THREADS=1"],
        cwd=ROOT, env={**clean_environment(), "LATENT_NERF_MODELS": str(models)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "nothing to do" in result.stderr


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"prompt": ""}, "prompt is empty"),
        ({"prompt": "x", "quality": "ultra"}, "draft | standard | high"),
        ({"prompt": "x", "seed": -1}, "SEED is -1"),
        ({"prompt": "x", "seed": True}, "seed is a bool"),
        ({"prompt": ["x"]}, "prompt is a list"),
        ({"prompt": "x", "model": "../tiny"}, "model is a path"),
        ({"prompt": "x", "mesh": "/etc/passwd"}, "is no upload"),
        ({"prompt": "x", "mesh": "0" * 64 + ".obj"}, "not here any more"),
        ({"prompt": "x", "token": "/etc/passwd"}, "'token' cannot be asked for here"),
        ({"prompt": "x", "job": "/etc/passwd"}, "'job' cannot be asked for here"),
        ({"prompt": "x\0y"}, "NUL"),
        ({"prompt": "x", "sigma_s": "0.3"}, "SIGMA_S is given, but no sketch"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(server: Server, given: dict[str, object], words: str) -> None:
    answer = server.ask("POST", "/api/jobs", given)
    assert answer.status == 400
    assert words in answer.json["error"]
    assert "\n" not in answer.json["error"]


def test_bodies_that_are_no_request(server: Server) -> None:
    assert server.ask("POST", "/api/jobs", "not json", content_type="application/json").status == 400
    assert server.ask("POST", "/api/jobs", "[" * 50_000, content_type="application/json").status == 400
    assert server.ask("POST", "/api/jobs", "[1]", content_type="application/json").status == 400
    assert server.ask("POST", "/api/jobs", "prompt=x", content_type="text/plain").status == 415
    large = json.dumps({"prompt": "x" * 70_000})
    assert server.ask("POST", "/api/jobs", large, content_type="application/json").status == 413


@pytest.mark.parametrize(
    "path",
    [
        "/runs/../../etc/passwd", "/runs/..%2f..%2fetc/passwd", "/runs/%2e%2e/x.png", "/runs/.server/token",
        "/runs/latest/asset.glb", "/runs/a/..%2f..%2fx.png", "/static/..%2faccess.py", "/static/app.py",
        "/api/jobs/nothing", "/runs/nothing/asset.glb", "/runs/A%00/asset.glb",
    ],
)  # fmt: skip
def test_nothing_outside_a_run_is_given_out(server: Server, path: str) -> None:
    assert server.ask("GET", path).status in (400, 404)


def test_hidden_files_links_and_logs_of_a_run_stay(server: Server, out: Path, tmp_path: Path) -> None:
    folder = out / "planted"
    folder.mkdir(exist_ok=True)
    (tmp_path / "secret.png").write_text("secret")
    (folder / "link.png").symlink_to(tmp_path / "secret.png")
    (folder / ".hidden.png").write_text("secret")
    (folder / "run.log").write_text("secret")
    (folder / "shown.png").write_text("shown")
    for name in ("link.png", ".hidden.png", "run.log"):
        assert server.ask("GET", f"/runs/planted/{name}").status == 404
    assert server.ask("GET", "/runs/planted/shown.png").status == 200


def test_pages_of_other_sites_may_not_ask(server: Server) -> None:
    own = server.address.rstrip("/")
    for headers in (
        {"origin": "https://evil.example"},
        {"origin": "null"},
        {"sec_fetch_site": "cross-site"},
        {"sec_fetch_site": "same-site"},
        {"origin": own.replace("http", "https") + "0"},
    ):
        assert server.ask("POST", "/api/jobs", asked(), **headers).status == 403
        assert server.ask("GET", "/api/jobs", **headers).status == 403
    assert server.ask("GET", "/api/jobs", host="evil.example").status == 421
    assert server.ask("GET", "/api/jobs", host="127.0.0.1.evil.example:80").status == 421
    assert server.ask("POST", "/api/jobs", asked(), origin=own, sec_fetch_site="same-origin").status == 201
    # A link from elsewhere may open the page.
    assert server.ask("GET", "/", sec_fetch_site="cross-site", sec_fetch_mode="navigate").status == 200


def test_every_answer_says_what_it_may_do(server: Server) -> None:
    for path in ("/", "/api", "/runs/", "/static/app.js", "/nothing"):
        headers = server.ask("GET", path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "SAMEORIGIN"
        assert "frame-ancestors 'self'" in headers["content-security-policy"]
        assert "access-control-allow-origin" not in headers
    assert "script-src 'self'" in server.ask("GET", "/").headers["content-security-policy"]


def test_uploads_are_kept_by_their_content_alone(server: Server, out: Path) -> None:
    names = [
        "fish.obj",
        "../../../etc/cron.d/x.OBJ",
        "C:\\x\\a b.obj",
        "%00.obj",
        "🪑.obj",
        "a" * 5000 + ".obj",
    ]
    for name in names:
        answer = server.ask("POST", f"/api/uploads?name={quote(name)}", TRIANGLE, **BINARY)
        assert (answer.status, answer.json["kind"]) == (201, "mesh"), name
    kept = sorted(path.name for path in (out / ".server" / "uploads").iterdir())
    assert kept == [answer.json["id"]]
    assert server.ask("POST", "/api/uploads?name=x.exe", TRIANGLE, **BINARY).status == 400
    assert server.ask("POST", "/api/uploads", TRIANGLE, **BINARY).status == 400
    assert server.ask("POST", "/api/uploads?name=x.obj", b"", **BINARY).status == 400
    assert server.ask("POST", "/api/uploads?name=x.obj", TRIANGLE, content_type="text/plain").status == 415
    job = server.ask("POST", "/api/jobs", asked(sketch=kept[0], sigma_s=0.3))
    assert job.status == 201
    assert job.json["job"]["sketch"] is True
    server.wait(job.json["name"], "done", "failed")


def test_uploads_that_are_too_large_leave_nothing(server: Server, out: Path) -> None:
    before = sorted((out / ".server" / "uploads").glob("*")) if (out / ".server" / "uploads").exists() else []
    with socket.create_connection((server.place.hostname, server.place.port), timeout=30) as line:
        line.sendall(
            b"POST /api/uploads?name=x.obj HTTP/1.1\r\nHost: 127.0.0.1\r\ncontent-length: 999999999\r\n"
            b"content-type: application/octet-stream\r\n\r\nv 0"
        )
        assert b"413" in line.recv(1000), "what is announced as too large is refused at once"
    with socket.create_connection((server.place.hostname, server.place.port), timeout=60) as line:
        line.sendall(
            b"POST /api/uploads?name=x.obj HTTP/1.1\r\nHost: 127.0.0.1\r\ntransfer-encoding: chunked\r\n"
            b"content-type: application/octet-stream\r\n\r\n"
        )
        try:  # what is not announced is cut off where it gets too large
            for _ in range(70):
                line.sendall(b"100000\r\n" + b"x" * 2**20 + b"\r\n")
            head = line.recv(1000)
        except OSError:
            head = b"413"
        assert b"413" in head
    assert server.ask("GET", "/api").status == 200
    assert sorted((out / ".server" / "uploads").glob("*")) == before
    assert not list((out / ".server" / "uploads").glob(".*.part"))


def test_connections_that_end_early_harm_nothing(server: Server, out: Path) -> None:
    for said in (
        b"",
        b"GET",
        b"\x16\x03\x01\x00\xff",
        b"POST /api/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\ncontent-length: 50\r\n\r\n{",
    ):
        with socket.create_connection((server.place.hostname, server.place.port)) as line:
            line.sendall(said)
    head = b"POST /api/uploads?name=x.obj HTTP/1.1\r\nHost: 127.0.0.1\r\ncontent-length: 500\r\n"
    with socket.create_connection((server.place.hostname, server.place.port)) as line:
        line.sendall(head + b"content-type: application/octet-stream\r\n\r\nv 0 0 0\n")
        time.sleep(0.3)
    deadline = time.monotonic() + 10
    while list((out / ".server" / "uploads").glob(".*.part")) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not list((out / ".server" / "uploads").glob(".*.part"))
    assert server.ask("GET", "/api").status == 200


def test_twenty_at_once_are_all_there_once(server: Server) -> None:
    with ThreadPoolExecutor(20) as pool:
        answers = list(
            pool.map(lambda seed: server.ask("POST", "/api/jobs", asked(seed=seed % 10)), range(20))
        )
    assert [answer.status for answer in answers] == [201] * 20
    names = {answer.json["name"] for answer in answers}
    assert len(names) == 10
    listed = [job["name"] for job in server.ask("GET", "/api/jobs").json["jobs"]]
    assert len(listed) == len(set(listed))
    assert names <= set(listed)
    for name in names:
        server.ask("POST", f"/api/jobs/{name}/cancel", {})
    for name in names:
        assert server.wait(name, "stopped", "done")["state"] in ("stopped", "done")


def test_a_second_server_on_the_folder_is_refused(server: Server, out: Path) -> None:
    result = subprocess.run(
        [sys.executable, "-c", START, "serve", f"OUT={out}", "PORT=0"],
        cwd=ROOT, env=clean_environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 2
    assert result.stderr.startswith(f"error: {out} is served already, at {server.address}")


def test_a_port_that_is_taken_is_named(server: Server, tmp_path: Path) -> None:
    for words, said in (
        ([f"PORT={server.place.port}"], "cannot be listened on"),
        (["PORT=x"], "PORT is 'x'"),
        (["HOST=no.such.host.invalid"], "no address of this machine"),
    ):
        result = subprocess.run(
            [sys.executable, "-c", START, "serve", f"OUT={tmp_path}", *words],
            cwd=ROOT, env=clean_environment(), capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert result.returncode == 2
        assert said in result.stderr


def test_others_need_the_token(tmp_path: Path, models: Path) -> None:
    with serving(tmp_path / "runs", models, HOST="0.0.0.0") as server:
        token = server.place.query.removeprefix("token=")
        assert len(token) >= 32
        assert oct((tmp_path / "runs" / ".server" / "token").stat().st_mode)[-3:] == "600"
        assert server.ask("GET", "/").status == 401
        assert server.ask("GET", "/runs/").status == 401
        assert server.ask("GET", "/api", authorization="Bearer wrong").status == 401
        assert server.ask("GET", "/api", authorization=f"Bearer {token}").status == 200
        opened = server.ask("GET", f"/?token={token}")
        assert opened.status == 303
        cookie = opened.headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "samesite=strict" in cookie.lower()
        assert server.ask("GET", "/", cookie=cookie.partition(";")[0]).status == 200
        foreign = {"cookie": cookie.partition(";")[0], "origin": "https://evil.example"}
        assert server.ask("POST", "/api/jobs", asked(), **foreign).status == 403


def test_a_killed_server_loses_nothing(tmp_path: Path) -> None:
    """kill -9 in the middle of a training: the run ends with it, and the next server goes on from there."""
    out, models = tmp_path / "runs", tmp_path / "models"
    write_model(models, steps=150)
    with serving(out, models) as server:
        first = server.ask("POST", "/api/jobs", asked()).json["name"]
        second = server.ask("POST", "/api/jobs", asked(seed=1)).json["name"]
        deadline = time.monotonic() + 120
        while not list((out / first / "checkpoints" / "train_nerf").glob("*.checkpoint")):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        os.kill(server.process.pid, signal.SIGKILL)
        server.process.communicate()
    with serving(out, models) as server:
        states = {job["name"]: job["state"] for job in server.ask("GET", "/api/jobs").json["jobs"]}
        assert set(states) == {first, second}
        assert server.wait(first, "done", "failed")["state"] == "done"
        resumed = json.loads((out / first / "stages" / "train_nerf.json").read_text())["metrics"][
            "resumed_at"
        ]
        assert resumed > 0
        # Told to end, it ends the run first, which keeps its last step.
        deadline = time.monotonic() + 120
        while not list((out / second / "checkpoints" / "train_nerf").glob("*")):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        ended = threading.Thread(target=server.end)
        ended.start()
        ended.join(60)
        assert not ended.is_alive()
    kept = json.loads((out / ".server" / "jobs" / f"{second}.json").read_text())
    assert kept["state"] == "queued"
