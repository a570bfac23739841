"""The methods that OPC UA clients call: the page's routes, with refusals as OPC UA status codes."""

from collections.abc import Awaitable, Callable
from typing import Any

from asyncua import ua
from pydantic import ValidationError

from truestand.core.errors import BadRecipe, TruestandError
from truestand.web.app_state import AppState
from truestand.web.interfaces.access import caller
from truestand.web.models import JobBody
from truestand.web.problem import Problem
from truestand.web.routes import jobs, stand

Codes = ua.StatusCodes
CODES = {404: Codes.BadNotFound, 409: Codes.BadInvalidState, 422: Codes.BadInvalidArgument}
START = {
    "kind": "calibrate, inspect or verify",
    "part": "name of the part's recipe; empty unless a part is inspected",
    "operator": "who does it; with users it is who is logged in",
    "order": "the order's number, or empty",
    "serial": "the part's or the shaft's serial number, or empty",
}
Answer = list[ua.Variant] | ua.StatusCode


class Methods:
    """The server's methods; ``show_refusal`` shows why the last call was refused, or an empty text."""

    def __init__(self, state: AppState, show_refusal: Callable[[str], Awaitable[None]]) -> None:
        self._state, self._show_refusal = state, show_refusal

    async def start(self, parent: ua.NodeId, *given: ua.Variant) -> Answer:
        """Start a job; its id."""
        texts = [argument.Value for argument in given]
        if len(texts) != len(START) or not all(text is None or isinstance(text, str) for text in texts):
            return _code(Codes.BadInvalidArgument)
        return await self._answer(self._start({name: text for name, text in zip(START, texts, strict=True) if text}))

    async def abort(self, parent: ua.NodeId, *given: ua.Variant) -> Answer:
        """Abort the job that runs; its id."""
        return await self._answer(self._abort())

    async def reset(self, parent: ua.NodeId, *given: ua.Variant) -> Answer:
        """Reset the latched fault; what it was, or an empty text."""
        return await self._answer(self._reset())

    async def _start(self, body: dict[str, str]) -> str:
        return str((await jobs.start(JobBody.model_validate(body), self._state, caller.get()))["id"])

    async def _abort(self) -> str:
        job = self._state.runner.current()
        if job is None or job["state"] != "running":
            raise Problem(409, "found no job running, nothing to abort")
        return str(jobs.abort(job["id"], self._state)["id"])

    async def _reset(self) -> str:
        return (await stand.reset(self._state)).fault or ""

    async def _answer(self, call: Awaitable[str]) -> Answer:
        try:
            answer = await call
        except (Problem, ValidationError, TruestandError, OSError) as wrong:
            text, code = refusal(wrong)
            await self._show_refusal(text)
            return _code(code)
        await self._show_refusal("")
        return [ua.Variant(answer, ua.VariantType.String)]


def refusal(wrong: Exception) -> tuple[str, int]:
    """A refusal's text and its OPC UA status code."""
    if isinstance(wrong, Problem):
        return wrong.detail, CODES.get(wrong.status_code, Codes.BadInternalError)
    if isinstance(wrong, ValidationError):
        first: Any = wrong.errors()[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}", Codes.BadInvalidArgument
    return str(wrong), Codes.BadInvalidArgument if isinstance(wrong, BadRecipe) else Codes.BadInvalidState


def _code(code: int) -> ua.StatusCode:
    return ua.StatusCode(ua.UInt32(code))
