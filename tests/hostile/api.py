"""The control API under generated requests, over its Unix socket: schemathesis makes them from the OpenAPI document.

Of each request with a body, mutants go out as well; and settings with live keys and values that nobody should write. All of
schemathesis' checks are on. Besides, a request that is answered with an error must have changed nothing.
"""

from __future__ import annotations

import json
import random
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import httpx
import requests
import schemathesis
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import Case, GenerationMode
from schemathesis.config import SchemathesisConfig
from schemathesis.core.failures import FailureGroup
from schemathesis.core.transport import Response

from hapticd.config import LIVE_KEYS
from hapticd.control.endpoints import Endpoints, JsonDict
from hapticd.service.api import openapi_document
from hapticd.service.replies import MAX_BODY_BYTES
from tests.hostile.mutation import SCALARS, mutated_text

STREAM: Final = "/stream"
"""Its reply does not end; left out."""
_FAILED: Final = 500
_MUTANTS: Final = 2
_SETTINGS: Final = 10
_JSON: Final = {"content-type": "application/json"}
_CHECKS: Final = {
    # Which keys and values a setting may have is the config's business, and said with 422.
    "positive_data_acceptance": {"expected-statuses": ["2xx", "409", "422"]},
}


@dataclass
class Report:
    """How many requests were answered, with which statuses, and what may not happen: in words, with the first example."""

    requests: int = 0
    answers: Counter[int] = field(default_factory=Counter)
    findings: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class State:
    """What no refused request may change.

    Two things change it by themselves: an experiment that runs, and a shaft that is rendered until it is too fast.
    """

    digest: str
    epoch: int
    experiment: int
    running: bool
    rest: tuple[Any, ...]

    @classmethod
    def of(cls, control: Endpoints) -> State:
        """As the daemon tells it."""
        status = control.status()
        job: JsonDict = status["experiment"] or {}
        fault = (status["fault"] or {}).get("code")
        rest = (status["state"], fault, status["origin_counts"])
        return cls(
            status["config_digest"], status["settings_epoch"], job.get("id", 0), job.get("state") == "running", rest
        )

    def same_as(self, later: State) -> bool:
        """Whether nothing has changed that should not have."""
        epoch = later.epoch if self.running else self.epoch  # an experiment publishes parameters of its own
        kept = (self.digest, epoch, self.experiment) == (later.digest, later.epoch, later.experiment)
        too_fast = (self.rest[0], later.rest[1]) == ("running", "over_speed")
        return kept and (self.running or too_fast or self.rest == later.rest)


class Attack:
    """Sends requests to one daemon.

    Args:
        control: the daemon, or what stands for it. socket: where its API is. number: seed of everything.
        path: of the only endpoint to attack; None: all.
        examples: of each endpoint, before it is the next one's turn: so each meets many states of the daemon.
    """

    def __init__(
        self, control: Endpoints, socket: Path, number: int, path: str | None = None, examples: int = 20
    ) -> None:
        self.report = Report()
        self._control, self._number, self._examples = control, number, examples
        self._chance = random.Random(number)
        self._client = httpx.Client(
            transport=httpx.HTTPTransport(uds=str(socket)), base_url="http://hapticd", timeout=30
        )
        document = openapi_document()
        del document["paths"][STREAM]
        config = SchemathesisConfig.from_dict({"checks": _CHECKS})
        schema = schemathesis.openapi.from_dict(document, config=config)
        operations = [found.ok() for found in schema.get_all_operations()]
        self._operations = [operation for operation in operations if path in (None, operation.path)]
        self._bodies: list[bytes] = [b"{}"]

    def run(self, count: int) -> Report:
        """Send that many requests, or a few more."""
        turn = 0
        with self._client:
            while self.report.requests < count:
                for operation in self._operations:
                    for mode in GenerationMode:
                        self._generated(operation, mode, turn)
                    self._some_settings()
                turn += 1
        return self.report

    def _generated(self, operation: Any, mode: GenerationMode, turn: int) -> None:
        @seed(self._number + turn)
        @settings(
            max_examples=self._examples,
            database=None,
            deadline=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(case=operation.as_strategy(generation_mode=mode))
        def send(case: Case) -> None:
            self._send_case(case)

        with suppress(Unsatisfiable):  # nothing can be wrong about a request without parameters
            send()

    def _send_case(self, case: Case) -> None:
        words = case.as_transport_kwargs(base_url="http://hapticd")
        known = {
            key: words[key] for key in ("method", "url", "headers", "params", "data", "json", "cookies") if key in words
        }
        prepared = requests.Request(**known).prepare()
        body = prepared.body.encode() if isinstance(prepared.body, str) else prepared.body or b""
        reply = self._send(case.method, str(prepared.url), body, dict(prepared.headers))
        try:
            case.validate_response(Response.from_httpx(reply, verify=False))
        except FailureGroup as group:
            for failure in group.exceptions:
                self._found(case.method, case.path, str(getattr(failure, "title", failure)), reply)
        if body:
            self._bodies = [*self._bodies[-50:], body]
            for _ in range(_MUTANTS):
                with suppress(UnicodeDecodeError):  # a body that is no text has no mutants
                    mutant = mutated_text(self._chance, body, self._bodies)
                    self._send(case.method, str(prepared.url), mutant, _JSON)

    def _some_settings(self) -> None:
        for _ in range(_SETTINGS):
            keys = self._chance.sample(sorted(LIVE_KEYS), self._chance.randrange(1, 4))
            values = {key: self._value() for key in keys}
            body = json.dumps({"settings": values, "force": self._chance.random() < 0.5})
            self._send("POST", "/set", body.encode(errors="replace"), _JSON)

    def _value(self) -> Any:
        """A hostile scalar as YAML text, or as the number or list that it is."""
        text = self._chance.choice(SCALARS)
        with suppress(ValueError):
            return self._chance.choice((text, float(text), 10**30, [text]))
        return text

    def _send(self, method: str, url: str, body: bytes, headers: dict[str, str]) -> httpx.Response:
        before = State.of(self._control)
        try:
            reply = self._client.request(method, url, content=body, headers=headers)
        except httpx.TransportError:
            if len(body) <= MAX_BODY_BYTES:
                raise
            # The daemon has answered and closed before it had read all of what is too long.
            reply = httpx.Response(413)
        self.report.requests += 1
        self.report.answers[reply.status_code] += 1
        path = httpx.URL(url).path
        if reply.status_code >= _FAILED:
            self._found(method, path, f"status {reply.status_code}", reply, body)
        elif reply.is_error and not before.same_as(after := State.of(self._control)):
            self._found(
                method, path, "an error that changed something", reply, f"{before} became {after} with ".encode() + body
            )
        return reply

    def _found(self, method: str, path: str, what: str, reply: httpx.Response, body: bytes = b"") -> None:
        words = f"{body[:700]!r} was answered {reply.status_code} {reply.text[:300]}"
        self.report.findings.setdefault(f"{method} {path}: {what}", words)
