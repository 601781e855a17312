"""The control API: HTTP and JSON on a Unix socket, served from a thread of its own.

No request reaches the servo thread. Requests are answered by small pools of threads, so that a flood of them can
neither pile up threads nor stand in the way of a stop: queries, commands (one at a time, in order), stops, e-stops.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import uvicorn
from fastapi import FastAPI
from starlette.responses import PlainTextResponse, Response, StreamingResponse

from hapticd.service import replies, schemas, socket
from hapticd.service.access import CALLER, Access, CallerProtocol, Rules
from hapticd.service.control import Control, JsonDict
from hapticd.service.metrics import CONTENT_TYPE

log = logging.getLogger("hapticd.api")

DESCRIPTION = """Control of a running hapticd daemon over its Unix socket.

Everyone who may write to the socket may command the motor, unless `api.watch_group` is set: then members of `api.group` may,
and members of `api.watch_group` may use the GET methods alone. The kernel says who a caller is.
`/estop` is a software stop, not a safety-rated one.
"""

ERRORS: dict[int | str, dict[str, Any]] = {
    400: {"model": schemas.ErrorReply, "description": "The body is not JSON."},
    403: {"model": schemas.ErrorReply, "description": "The caller may only watch."},
    409: {"model": schemas.ErrorReply, "description": "Refused in the daemon's present state."},
    413: {"model": schemas.ErrorReply, "description": "The body is longer than 64 KiB."},
    422: {"model": schemas.ErrorReply, "description": "The request or a setting in it is wrong."},
    502: {"model": schemas.ErrorReply, "description": "The device or its driver failed."},
}

STREAM_TYPE = "application/vnd.hapticd.frames"

BODIES: dict[str, type[schemas.Request]] = {
    "/start": schemas.StartBody,
    "/clear": schemas.EmptyBody,
    "/set": schemas.SetBody,
    "/release": schemas.ReleaseBody,
    "/excite": schemas.ExciteBody,
    "/record/start": schemas.RecordBody,
    "/record/stop": schemas.EmptyBody,
    "/reload": schemas.ReloadBody,
}


class Executor:
    """One queue of requests with its own threads.

    Args:
        name: of its threads.
        workers: how many.
        told: whether the log says who asks for what.
    """

    def __init__(self, name: str, workers: int, *, told: bool = True) -> None:
        self._told = told
        self.pool = ThreadPoolExecutor(workers, thread_name_prefix=f"hapticd-{name}")

    async def run(self, method: Callable[..., JsonDict | bytes], *arguments: Any) -> Response:
        """Call ``method`` on one of the threads and reply with what it returns; bytes are text as they are."""
        if self._told and (caller := CALLER.get()) is not None:
            fields = {"uid": caller.uid, "pid": caller.pid, "request": method.__name__}
            log.info("%s: %s%s", caller, method.__name__, arguments, extra={"journal": fields})
        try:
            answer = await asyncio.get_running_loop().run_in_executor(self.pool, method, *arguments)
        except replies.ANSWERS:
            raise
        except Exception as error:
            log.exception("request failed")
            raise replies.Internal from error
        if isinstance(answer, bytes):
            return Response(answer, media_type=CONTENT_TYPE)
        return replies.JsonReply(answer)


class Executors:
    """The executors of one API. Stops have their own, so that nothing slow is ever in front of them."""

    def __init__(self) -> None:
        self.queries = Executor("query", 2, told=False)
        self.commands = Executor("command", 1)
        self.stops = Executor("stop", 1)
        self.estops = Executor("estop", 2)

    def close(self) -> None:
        """Let the threads go; what waits is dropped, what runs is not waited for."""
        for executor in (self.queries, self.commands, self.stops, self.estops):
            executor.pool.shutdown(wait=False, cancel_futures=True)


def create_app(control: Control, executors: Executors | None = None, rules: Rules | None = None) -> FastAPI:
    """The API of one daemon.

    Args:
        control: the daemon.
        executors: threads to answer on; made here when None.
        rules: who may ask for what; None: whoever is let in by the socket's permissions, for everything.
    """
    executors = executors or Executors()
    app = FastAPI(title="hapticd", version="1", description=DESCRIPTION, docs_url=None, redoc_url=None)
    replies.install(app, BODIES)
    app.add_middleware(Access, rules=rules or Rules())
    _add_queries(app, control, executors)
    _add_commands(app, control, executors)
    _add_experiments(app, control, executors)
    return app


def openapi_document() -> dict[str, Any]:
    """The OpenAPI document, without a daemon."""
    return create_app(cast(Control, _Nobody())).openapi()


class _Nobody:
    """Stands where the daemon would be while the document is made; no method of it is ever called."""

    def __getattr__(self, name: str) -> None:
        return None


def _documented(model: type[schemas.Reply] | None, *errors: int) -> dict[str, Any]:
    """Route arguments: the reply's shape is documented, not re-validated, because the daemon made it."""
    responses = {code: ERRORS[code] for code in errors}
    if model is not None:
        responses[200] = {"model": model, "description": "Done."}
    return {"response_class": replies.JsonReply, "response_model": None, "responses": responses}


def _add_queries(app: FastAPI, control: Control, executors: Executors) -> None:
    @app.get("/status", **_documented(schemas.Status))
    async def status() -> Response:
        """State, fault, timing, operating point, position and recorder."""
        return await executors.queries.run(control.status)

    @app.get("/config", **_documented(None))
    async def config() -> Response:
        """The config in force, section by section."""
        return await executors.queries.run(control.config)

    @app.get("/metrics", response_class=PlainTextResponse)
    async def metrics() -> Response:
        """Ticks, misses, lateness, state, faults, recorder and energies, in Prometheus' text format."""
        return await executors.queries.run(control.metrics)

    @app.get("/stream", response_class=StreamingResponse, responses={409: ERRORS[409]})
    async def stream() -> Response:
        """Every tick as it comes: binary frames, each with its length in four bytes before it, until the reader leaves."""
        control.live.refuse_more()
        return StreamingResponse(control.live.chunks(), media_type=STREAM_TYPE)

    @app.get("/experiment", **_documented(schemas.Experiment))
    async def experiment() -> Response:
        """The newest experiment and how far it is."""
        return await executors.queries.run(control.experiment)


def _add_commands(app: FastAPI, control: Control, executors: Executors) -> None:
    refusable = _documented(schemas.Status, 400, 403, 409, 413, 422, 502)
    judged = _documented(schemas.JudgedStatus, 400, 403, 409, 413, 422, 502)

    @app.post("/start", **judged)
    async def start(body: schemas.StartBody | None = None) -> Response:
        """Enable the amplifier and render the spring, unless theory says that its motion would not die out."""
        return await executors.commands.run(control.start, bool(body and body.force))

    @app.post("/stop", **_documented(schemas.Status, 403, 502))
    async def stop() -> Response:
        """Zero current, then disable; ends a running experiment. Whatever the body says is ignored."""
        return await executors.stops.run(control.stop)

    @app.post("/estop", **_documented(schemas.Status, 403))
    async def estop() -> Response:
        """Zero current at once, disable, latch a fault. Answered beside all other requests; any body is ignored."""
        return await executors.estops.run(control.estop)

    @app.post("/clear", **refusable)
    async def clear(body: schemas.EmptyBody | None = None) -> Response:
        """Clear a latched fault."""
        return await executors.commands.run(control.clear)

    @app.post("/set", **_documented(schemas.SetReply, 400, 403, 409, 413, 422))
    async def change(body: schemas.SetBody) -> Response:
        """Change live settings, all or none, between two ticks."""
        return await executors.commands.run(control.set, dict(body.settings), body.force)

    @app.post("/reload", **judged)
    async def reload(body: schemas.ReloadBody | None = None) -> Response:
        """Read the config anew; a wrong one leaves the one in force untouched."""
        return await executors.commands.run(control.reload, body.path if body else None, bool(body and body.force))

    @app.post("/record/start", **_documented(schemas.RecorderStatus, 400, 403, 409, 413, 422))
    async def record_start(body: schemas.RecordBody | None = None) -> Response:
        """Start recording every tick."""
        caller = CALLER.get()
        trusted = caller is not None and caller.is_own_user
        return await executors.commands.run(control.record_start, body.path if body else None, trusted)

    @app.post("/record/stop", **_documented(schemas.RecorderStatus, 400, 403, 409, 413, 422))
    async def record_stop(body: schemas.EmptyBody | None = None) -> Response:
        """Stop recording and close the file."""
        return await executors.commands.run(control.record_stop)


def _add_experiments(app: FastAPI, control: Control, executors: Executors) -> None:
    @app.post("/release", **_documented(schemas.ReleaseReply, 400, 403, 409, 413, 422, 502))
    async def release(body: schemas.ReleaseBody) -> Response:
        """Start the Fig. 8 experiment; poll /experiment for its end."""
        return await executors.commands.run(control.release, float(body.deflection), body.duration_s, body.force)

    @app.post("/excite", **_documented(schemas.JobReply, 400, 403, 409, 413, 422, 502))
    async def excite(body: schemas.ExciteBody) -> Response:
        """Start an identification experiment; poll /experiment for its end."""
        options = body.model_dump(exclude={"name", "force"}, exclude_none=True)
        return await executors.commands.run(control.excite, body.name, options, body.force)


class ApiServer:
    """The API on its socket, in the thread ``hapticd-api``.

    Args:
        control: the daemon.
        bound: the socket from :func:`hapticd.service.socket.bind`; bound before the device is opened, so that the daemon
            that has the socket is alone with the device. Closed by :meth:`stop`.
        rules: who may ask for what.
    """

    STOP_TIMEOUT_S = 5.0

    def __init__(self, control: Control, bound: socket.BoundSocket, rules: Rules | None = None) -> None:
        self._bound = bound
        self._control = control
        self._executors = Executors()
        settings = uvicorn.Config(
            create_app(control, self._executors, rules),
            http=CallerProtocol,
            ws="none",
            lifespan="off",
            loop="asyncio",
            backlog=socket.BACKLOG,
            log_config=None,
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(settings)
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin to answer.

        Raises:
            SocketError: the server does not start; nothing is left behind.
        """
        # uvicorn takes over signal handlers only in the main thread, and this is not it.
        self._thread = threading.Thread(
            target=self._server.run, kwargs={"sockets": [self._bound.socket]}, name="hapticd-api", daemon=True
        )
        self._thread.start()
        while not self._server.started:
            if not self._thread.is_alive():
                self.stop()
                raise socket.SocketError(f"the control API did not start on {self._bound.path}; its log says why")
            time.sleep(0.005)

    def stop(self) -> None:
        """Stop answering and remove the socket. Safe to call twice and without a start."""
        self._control.live.close()
        self._server.should_exit = True
        if self._thread is not None:
            self._thread.join(self.STOP_TIMEOUT_S)
            self._thread = None
        self._bound.close()
        self._executors.close()
