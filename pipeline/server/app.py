"""The HTTP API, and the page over it. docs/deployment.md lists the requests."""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any, NoReturn

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from pipeline.documents import parse_object, whole_number
from pipeline.errors import InputError
from pipeline.files import refusal
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.options.models import DEFAULT_MODEL, known_models
from pipeline.options.quality import QUALITY
from pipeline.report import gallery
from pipeline.report.viewer import three_js, viewer_js
from pipeline.run.verify import verify
from pipeline.server import uploads
from pipeline.server.access import Access
from pipeline.server.queue import Asked, Queue, is_name
from pipeline.training.loop import PREVIEW

PAGE = Path(__file__).with_name("page")
LONGEST = 64 * 1024
"""Of a request that is no upload [bytes]."""
TEXTS = ("PROMPT", "NEGATIVE", "QUALITY", "SEED", "MODEL", "SIGMA_S", "PARAM")
"""What a request may say, in small letters, as make's variables have it. None of them is a path."""
FILES = {
    ".glb": "model/gltf-binary", ".gltf": "model/gltf+json", ".obj": "text/plain", ".mtl": "text/plain",
    ".ply": "application/octet-stream", ".stl": "model/stl", ".usdz": "model/vnd.usdz+zip",
    ".3mf": "model/3mf",
    ".fbx": "application/octet-stream", ".png": "image/png", ".mp4": "video/mp4", ".html": "text/html",
    ".json": "application/json", ".yaml": "text/plain", ".zip": "application/zip",
}  # fmt: skip
"""What is given out of a run's folder, by ending."""
REPORT_POLICY = "frame-ancestors 'self'"
"""Of pages that bring the rest of their policy themselves."""


def make_app(queue: Queue, token: str = "") -> ASGIApp:
    """Return the application.

    Args:
        queue: whose jobs it shows; its worker runs as long as the application.
        token: asked of every visitor; empty: none, and only this machine's own names are answered to.
    """
    api = _Api(queue)
    routes = [
        Route("/", api.page),
        Route("/static/{name}", api.static),
        Route("/api", api.about),
        Route("/api/jobs", api.list_jobs),
        Route("/api/jobs", api.ask, methods=["POST"]),
        Route("/api/jobs/{name}", api.tell),
        Route("/api/jobs/{name}/cancel", api.cancel, methods=["POST"]),
        Route("/api/jobs/{name}/resume", api.resume, methods=["POST"]),
        Route("/api/jobs/{name}/verify", api.verify, methods=["POST"]),
        Route("/api/uploads", api.upload, methods=["POST"]),
        Route("/runs/", api.gallery),
        Route("/runs/{name}/growing.png", api.growing),
        Route("/runs/{name}/{file}", api.file),
    ]

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        worker = asyncio.create_task(queue.work())
        try:
            yield
        finally:
            worker.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await worker

    handlers = {
        InputError: _input_error,
        HTTPException: _http_error,
        OSError: _os_error,
        ClientDisconnect: _gone,
    }
    return Access(Starlette(routes=routes, lifespan=lifespan, exception_handlers=handlers), token)


class _Api:
    """The answers."""

    def __init__(self, queue: Queue) -> None:
        self.queue = queue

    async def page(self, request: Request) -> Response:
        return FileResponse(PAGE / "index.html", media_type="text/html")

    async def static(self, request: Request) -> Response:
        name = request.path_params["name"]
        made = {"three.js": three_js, "viewer.js": viewer_js}
        if name in made:
            return Response(
                made[name](), media_type="text/javascript", headers={"cache-control": "max-age=3600"}
            )
        kinds = {"app.js": "text/javascript", "app.css": "text/css"}
        if name not in kinds:
            _missing()
        return FileResponse(PAGE / name, media_type=kinds[name])

    async def about(self, request: Request) -> Response:
        """Say what can be asked for, and how long each quality takes."""
        models = list(known_models())
        seconds = {}
        for quality in QUALITY:
            with contextlib.suppress(InputError):
                job = jobs.resolve({"PROMPT": "a red armchair", "QUALITY": quality})
                seconds[quality] = round(sum(self.queue.seconds_of(job).values()))
        return JSONResponse(
            {
                "models": models,
                "default_model": DEFAULT_MODEL,
                "quality_seconds": seconds,
                "meshes": uploads.MESHES,
                "drawings": uploads.DRAWINGS,
                "largest_upload": uploads.LARGEST,
            }
        )

    async def list_jobs(self, request: Request) -> Response:
        """List what was asked for, the newest first, and the finished runs of the folder."""
        asked = sorted(self.queue.asked.values(), key=lambda one: -one.number)
        cards = await asyncio.to_thread(gallery.find_runs, self.queue.out)
        return JSONResponse(
            {
                "jobs": [self._told(one) for one in asked],
                "runs": [{"name": c.name, "job": c.job, "seconds": c.seconds} for c in cards],
            }
        )

    async def ask(self, request: Request) -> Response:
        """Ask for an asset: 201 with its job; the same job asked for again is the same."""
        given = await _json(request)
        job = await asyncio.to_thread(self._resolved, given)
        return JSONResponse(self._told(self.queue.ask(job)), 201)

    def _resolved(self, given: Mapping[str, Any]) -> Job:
        names = {name.lower(): name for name in TEXTS}
        known = {*names, "refine", "mesh", "sketch"}
        if extra := sorted(set(given) - known):
            raise InputError(f"{extra[0]!r} cannot be asked for here; there are: {', '.join(sorted(known))}")
        variables = {}
        for key, value in given.items():
            if key in names and value not in ("", None):
                if not isinstance(value, (str, int, float)) or isinstance(value, bool):
                    raise InputError(f"{key} is a {type(value).__name__}, expected text or a number")
                variables[names[key]] = str(value)
        if "/" in variables.get("MODEL", "") or "\\" in variables.get("MODEL", ""):
            raise InputError("model is a path: say one of those that /api lists")
        if given.get("refine"):
            variables["REFINE"] = "1"
        for key in ("mesh", "sketch"):
            if given.get(key):
                path = uploads.path_of(self.queue.out / ".server" / "uploads", given[key])
                variables[key.upper()] = str(path)
        return jobs.resolve(variables)

    async def tell(self, request: Request) -> Response:
        return JSONResponse(self._told(self._asked(request)))

    async def cancel(self, request: Request) -> Response:
        """Stop a job; what it has made stays."""
        asked = self._asked(request)
        self.queue.stop(asked.name)
        return JSONResponse(self._told(asked))

    async def resume(self, request: Request) -> Response:
        """Go on with a job that stopped or failed."""
        asked = self._asked(request)
        return JSONResponse(self._told(self.queue.ask(asked.job)))

    async def verify(self, request: Request) -> Response:
        """Check every file of a finished run against its manifest."""
        folder = self._folder(request.path_params["name"])
        count, faults = await asyncio.to_thread(verify, folder)
        return JSONResponse({"files": count, "faults": faults})

    async def upload(self, request: Request) -> Response:
        """Take a mesh or a drawing, named by the query's `name`: 201 with the id to ask with."""
        name = request.query_params.get("name", "")
        identity = await uploads.keep(self.queue.out / ".server" / "uploads", name, _stream(request))
        kind = "drawing" if identity.endswith(uploads.DRAWINGS) else "mesh"
        return JSONResponse({"id": identity, "kind": kind}, 201)

    async def gallery(self, request: Request) -> Response:
        cards = await asyncio.to_thread(gallery.find_runs, self.queue.out)
        page = gallery.render(cards)
        return HTMLResponse(page, headers={"content-security-policy": REPORT_POLICY})

    async def growing(self, request: Request) -> Response:
        """Give the newest picture of a run that is being trained."""
        folder = self._folder(request.path_params["name"])
        pictures = sorted(folder.glob(f"checkpoints/*/{PREVIEW}"), key=lambda path: path.stat().st_mtime)
        if not pictures:
            _missing()
        return Response(
            pictures[-1].read_bytes(), media_type="image/png", headers={"cache-control": "no-store"}
        )

    async def file(self, request: Request) -> Response:
        """Give a file that lies in a run's folder itself."""
        folder, file = self._folder(request.path_params["name"]), request.path_params["file"]
        path = folder / file
        kind = FILES.get(path.suffix.lower())
        if (
            kind is None
            or file.startswith(".")
            or Path(file).name != file
            or path.is_symlink()
            or not path.is_file()
        ):
            _missing()
        headers = {"content-security-policy": REPORT_POLICY} if path.suffix == ".html" else {}
        answer = FileResponse(path, media_type=kind, headers=headers)
        if request.query_params.get("download") is not None:
            answer.headers["content-disposition"] = f'attachment; filename="{folder.name}-{file}"'
        return answer

    def _asked(self, request: Request) -> Asked:
        asked = self.queue.asked.get(request.path_params["name"])
        if asked is None:
            _missing()
        return asked

    def _folder(self, name: str) -> Path:
        folder = self.queue.out / name
        if not is_name(name) or folder.is_symlink() or not folder.is_dir():
            _missing()
        return folder

    def _told(self, asked: Asked) -> dict[str, Any]:
        """Return a job as the API tells it."""
        job, folder = asked.job, self.queue.out / asked.name
        waiting = [one.number for one in self.queue.asked.values() if one.state in ("queued", "running")]
        told: dict[str, Any] = {
            "name": asked.name,
            "state": asked.state,
            "reason": asked.reason,
            "job": {
                "prompt": job.prompt, "negative": job.negative, "quality": job.quality, "seed": job.seed,
                "model": job.model, "refine": job.refine, "mesh": bool(job.mesh), "sketch": bool(job.sketch),
            },
            "before": sum(number < asked.number for number in waiting) if asked.state == "queued" else 0,
            "progress": None,
            "picture": None,
            "files": [],
        }  # fmt: skip
        if asked.state == "running":
            told["progress"] = asked.progress.told(time.monotonic() - asked.began)
        if asked.state in ("running", "stopped", "failed"):
            stamps = [path.stat().st_mtime_ns for path in folder.glob(f"checkpoints/*/{PREVIEW}")]
            told["picture"] = f"/runs/{asked.name}/growing.png?{max(stamps)}" if stamps else None
        if asked.state == "done":
            made = sorted(
                path.name for path in folder.glob("*") if path.suffix.lower() in FILES and path.is_file()
            )
            first = [name for name in made if name.startswith(("asset.", "asset_lod"))]
            others = (
                "albedo.png",
                "preview.png",
                "turntable.mp4",
                "report.html",
                "job.yaml",
                "manifest.json",
            )
            told["files"] = [
                {"name": name, "bytes": (folder / name).stat().st_size}
                for name in [*first, *(name for name in others if name in made)]
            ]
        return told


async def _json(request: Request) -> dict[str, Any]:
    """Return a request's JSON object."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise HTTPException(415, "send JSON, with content-type: application/json")
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > LONGEST:
            raise HTTPException(413, f"a request may have {LONGEST >> 10} kB")
    try:
        return parse_object(body)
    except ValueError as error:
        raise InputError(f"the request is no JSON object: {error}") from None


async def _stream(request: Request) -> AsyncIterator[bytes]:
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/octet-stream":
        raise HTTPException(415, "send the file's bytes, with content-type: application/octet-stream")
    if (whole_number(request.headers.get("content-length", "")) or 0) > uploads.LARGEST:
        raise uploads.TooLarge(f"the file is larger than {uploads.LARGEST >> 20} MB: make it smaller")
    async for chunk in request.stream():
        yield chunk


def _missing() -> NoReturn:
    raise HTTPException(404, "there is no such thing here")


async def _input_error(request: Request, error: Exception) -> Response:
    status = 413 if isinstance(error, uploads.TooLarge) else 400
    # What was not read of a request that is refused is not waited for.
    return JSONResponse(
        {"error": str(error)}, status, headers={"connection": "close"} if status == 413 else {}
    )


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail}, error.status_code, headers=error.headers)


async def _os_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, OSError)
    refused = refusal(error)
    return JSONResponse({"error": str(refused or error)}, 507 if refused else 500)


async def _gone(request: Request, error: Exception) -> Response:
    return Response(status_code=400)
