"""The control API: HTTP and JSON on a Unix socket, served from its own thread.

No request reaches the servo thread. Small thread pools, created at the start, answer requests: one for queries, one for
commands (one at a time, in order). So a flood of requests cannot create more threads or delay a stop. Stops are executed
when they arrive (`hapticd.service.arrivals`) and answered in the event loop.
"""

from __future__ import annotations

import asyncio
import logging
import socket as stdlib_socket
import threading
import time
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from inspect import Parameter, Signature
from typing import Any, Final, Protocol, cast

import uvicorn
from fastapi import FastAPI
from pydantic import BaseModel
from starlette.responses import PlainTextResponse, Response, StreamingResponse

from hapticd.control.endpoints import TEXT, Endpoint, Endpoints, JsonDict, Queue, declared
from hapticd.control.json_reply import JsonReply
from hapticd.control.schemas import ErrorReply, body_of, reply_of
from hapticd.service import replies, socket
from hapticd.service._metrics import CONTENT_TYPE
from hapticd.service.access import CALLER, Access, Caller, Rules, Turns
from hapticd.service.arrivals import ARRIVAL, Arrivals, Pending, Stoppable
from hapticd.service.guests import guests
from hapticd.service.halting import POLL_S
from hapticd.service.live import LiveStream
from hapticd.servo.authority import Command

log = logging.getLogger("hapticd.api")

DESCRIPTION = """Control of a running hapticd daemon over its Unix socket.

Everyone who may write to the socket may command the motor, unless `api.watch_group` is set: then members of `api.group` may,
and members of `api.watch_group` may use the GET methods alone. The kernel says who a caller is.
`/estop` is a software stop, not a safety-rated one.

A stop revokes every command that was sent before it. The header `Request-Sent-Ns` says when that was, CLOCK_MONOTONIC in ns;
without it a command counts as sent when its connection was last read before, or, on a new one, some 50 ms before it is met.
`Request-Deadline-Ns` says until when it may begin.
"""

ERRORS: dict[int | str, dict[str, Any]] = {
    400: {"model": ErrorReply, "description": "The body is not JSON."},
    403: {"model": ErrorReply, "description": "The caller may only watch."},
    409: {"model": ErrorReply, "description": "Refused in the daemon's present state."},
    413: {"model": ErrorReply, "description": "The body is longer than 64 KiB."},
    422: {"model": ErrorReply, "description": "The request or a setting in it is wrong."},
    502: {"model": ErrorReply, "description": "The device or its driver failed."},
}

STREAM_TYPE = "application/vnd.hapticd.frames"
_MOVE_S = 1.0


THREADS: Final[dict[Queue, int]] = {"query": 2, "command": 1, "note": 1}
"""Number of threads for each queue of requests."""
_READY_S = 5.0


def _pools() -> dict[Queue, ThreadPoolExecutor]:
    """Executors with all threads already running: no thread is created for a request.

    Raises:
        RuntimeError: a thread cannot be created.
    """
    pools: dict[Queue, ThreadPoolExecutor] = {}
    for queue, count in THREADS.items():
        pools[queue] = ThreadPoolExecutor(count, thread_name_prefix=f"hapticd-{queue}")
        together = threading.Barrier(count + 1)
        for _ in range(count):
            pools[queue].submit(together.wait, _READY_S)
        together.wait(_READY_S)
    return pools


class Control(Stoppable, Protocol):
    """The daemon's interface to the API: `Endpoints`, callable from any thread, and the live rows."""

    live: LiveStream

    def log_later(self, write: Callable[[], None]) -> None:
        """Write to the log from another thread."""


def create_app(
    control: Control, pools: Mapping[Queue, ThreadPoolExecutor] | None = None, rules: Rules | None = None
) -> FastAPI:
    """The API of one daemon: a route for each declared endpoint, and the stream.

    Args:
        control: the daemon; has a method for each of `Endpoints`.
        pools: threads for the answers; None: only the document is needed.
        rules: roles of the callers; None: everybody with permission on the socket may do everything.
    """
    app = FastAPI(title="hapticd", version="1", description=DESCRIPTION, docs_url=None, redoc_url=None)
    endpoints = declared(Endpoints)
    rules = rules or Rules()
    # Inside the layers of `install`: the body is read before the answer, else a caller that still sends does not get it.
    app.add_middleware(Access, rules=rules)
    replies.install(app, {endpoint.path: body for endpoint in endpoints if (body := body_of(endpoint))})
    app.add_middleware(Arrivals, control=control, rules=rules, endpoints=endpoints)
    for endpoint in endpoints:
        app.add_api_route(
            endpoint.path,
            answering(endpoint, control, pools[endpoint.queue] if pools and endpoint.queue in pools else None),
            methods=[endpoint.method],
            name=endpoint.name,
            description=endpoint.description,
            **_documented(endpoint),
        )

    @app.get("/stream", response_class=StreamingResponse, responses={409: ERRORS[409]})
    async def stream() -> Response:
        """Every tick, live: binary frames, each with its length in four bytes before it, until the reader disconnects."""
        control.live.refuse_more()
        return StreamingResponse(control.live.chunks(), media_type=STREAM_TYPE)

    return app


def openapi_document() -> dict[str, Any]:
    """The OpenAPI document, without a daemon."""
    return create_app(cast(Control, None)).openapi()


def answering(
    endpoint: Endpoint, control: Control, pool: ThreadPoolExecutor | None
) -> Callable[..., Awaitable[Response]]:
    """The function that FastAPI calls for a request; the body's fields become the arguments of the method."""
    model = body_of(endpoint)

    async def answer(body: BaseModel | None = None) -> Response:
        given = {} if body is None else body.model_dump(exclude_unset=True)
        caller, arrival = CALLER.get(), ARRIVAL.get()
        result: JsonDict | str
        try:
            if arrival.halt is not None:
                result = await _halted(arrival.halt)
                control.log_later(partial(_log_caller, endpoint, caller, given))
            else:
                if endpoint.asks_trust:
                    given["trusted"] = caller is not None and caller.is_own_user
                method = partial(getattr(control, endpoint.name), **given)
                if endpoint.queue == "command":
                    method = partial(_carry_out, endpoint, caller, method, arrival.command)
                result = await asyncio.get_running_loop().run_in_executor(pool, method)
        except replies.ANSWERS:
            raise
        except Exception as error:
            log.exception("request failed")
            raise replies.Internal from error
        finally:
            if arrival.command is not None:
                arrival.command.answered()
        return Response(result, media_type=CONTENT_TYPE) if isinstance(result, str) else JsonReply(result)

    # FastAPI takes the body's type from the signature. The body is optional if it has no required field.
    parameters = []
    if model is not None:
        needed = any(field.is_required() for field in model.model_fields.values())
        kind, default = Parameter.POSITIONAL_OR_KEYWORD, Parameter.empty if needed else None
        parameters = [Parameter("body", kind, default=default, annotation=model if needed else model | None)]
    answer.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return answer


async def _halted(halt: Pending) -> JsonDict:
    """The answer to a stop, once the current is zero."""
    while (answer := halt.poll()) is None:
        await asyncio.sleep(POLL_S)
    return answer


def _carry_out(
    endpoint: Endpoint, caller: Caller | None, method: partial[JsonDict], command: Command | None
) -> JsonDict:
    """Execute a command, and log its caller."""
    _log_caller(endpoint, caller, method.keywords)
    return method() if command is None else method(command=command)


def _log_caller(endpoint: Endpoint, caller: Caller | None, arguments: Mapping[str, Any]) -> None:
    """Log the caller of a command. To look up a user's name may be slow: a stop does not wait for it."""
    if caller is not None:
        fields = {"uid": caller.uid, "pid": caller.pid, "request": endpoint.name}
        text = ", ".join(f"{name}={value!r}" for name, value in arguments.items())
        log.info("%s: %s(%s)", caller, endpoint.name, text, extra={"journal": fields})


def _documented(endpoint: Endpoint) -> dict[str, Any]:
    """Route arguments: the reply's model is documented, but not validated again, because the daemon created the reply."""
    responses = {code: ERRORS[code] for code in endpoint.errors}
    if model := reply_of(endpoint):
        responses[200] = {"model": model, "description": "Done."}
    kind = PlainTextResponse if endpoint.reply == TEXT else JsonReply
    return {"response_class": kind, "response_model": None, "responses": responses}


class ApiServer:
    """The API server on its socket, in the thread ``hapticd-api``, which is created here and waits for :meth:`start`.

    Args:
        control: the daemon.
        bound: the socket from :func:`hapticd.service.socket.bind`, closed by :meth:`stop`; None: it is bound when all
            threads of the daemon exist, and passed to :meth:`start`.
        rules: roles of the callers.

    Raises:
        RuntimeError: a thread cannot be created.
    """

    STOP_TIMEOUT_S = 5.0

    def __init__(self, control: Control, bound: socket.BoundSocket | None = None, rules: Rules | None = None) -> None:
        self._bound = bound
        self._control = control
        self._pools = _pools()
        self._turns = Turns()
        settings = uvicorn.Config(
            create_app(control, self._pools, rules),
            http=guests(rules or Rules(), self._turns),
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
        self._may_start = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hapticd-api", daemon=True)
        self._thread.start()

    def start(self, bound: socket.BoundSocket | None = None) -> None:
        """Start to answer.

        Args:
            bound: the socket, if it was not given before.

        Raises:
            SocketError: the server does not start; everything is closed again.
        """
        self._bound = bound or self._bound
        assert self._bound is not None
        self._may_start.set()
        while not self._server.started:
            if not self._thread.is_alive():
                self.stop()
                raise socket.SocketError(f"the control API did not start on {self._bound.path}; its log says why")
            time.sleep(0.005)

    def _run(self) -> None:
        # uvicorn installs signal handlers only in the main thread, which this is not.
        self._may_start.wait()
        if self._bound is not None and not self._server.should_exit:
            asyncio.run(self._serve(self._bound.socket))

    async def _serve(self, listening: stdlib_socket.socket) -> None:
        self._turns.begin(asyncio.get_running_loop())
        await self._server.serve(sockets=[listening])

    def listen_on(self, listening: stdlib_socket.socket) -> None:
        """Accept connections on another socket instead; open connections continue. From any thread.

        Raises:
            TimeoutError: the event loop did not do it within a second; it will do it later.
        """
        loop = self._server.servers[0].get_loop()
        asyncio.run_coroutine_threadsafe(self._move_to(listening), loop).result(_MOVE_S)

    async def _move_to(self, listening: stdlib_socket.socket) -> None:
        for server in self._server.servers:
            server.close()
        await self._server.startup(sockets=[listening])

    def alive(self) -> bool:
        """Whether its thread runs."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Stop answering and remove the socket. Safe to call twice and without a start."""
        self._control.live.close()
        self._server.should_exit = True
        self._may_start.set()
        self._thread.join(self.STOP_TIMEOUT_S)
        if self._bound is not None:
            self._bound.close()
        for pool in self._pools.values():
            pool.shutdown(wait=False, cancel_futures=True)  # drop waiting requests, do not wait for running ones
