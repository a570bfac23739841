"""The methods that machines call: the page's routes, with refusals as OPC UA status codes."""

from collections.abc import Awaitable, Callable
from typing import Any

from asyncua import ua
from pydantic import ValidationError

from truestand.core.errors import BadRecipe, TruestandError
from truestand.web.app_state import Page
from truestand.web.interfaces.access import caller
from truestand.web.models import JobBody
from truestand.web.problem import Problem
from truestand.web.routes import devices, jobs

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
Method = Callable[..., Awaitable[Answer]]
Refuse = Callable[[str], Awaitable[None]]


class Methods:
    """What can be called; ``refuse`` shows why a call was refused, or nothing."""

    def __init__(self, page: Page, refuse: Refuse) -> None:
        self._page, self._refuse = page, refuse

    async def start(self, parent: ua.NodeId, *given: ua.Variant) -> Answer:
        """Start a job; its id."""
        texts = [argument.Value for argument in given]
        if len(texts) != len(START) or not all(text is None or isinstance(text, str) for text in texts):
            return _code(Codes.BadInvalidArgument)
        order = {name: text for name, text in zip(START, texts, strict=True) if text}

        async def do() -> str:
            return str((await jobs.start(JobBody.model_validate(order), self._page, caller.get()))["id"])

        return await self._answer(do)

    async def abort(self, parent: ua.NodeId, *given: ua.Variant) -> Answer:
        """Abort the job that runs; its id."""

        async def do() -> str:
            job = self._page.runner.current()
            if job is None or job["state"] != "running":
                raise Problem(409, "found no job running, nothing to abort")
            return str(jobs.abort(job["id"], self._page)["id"])

        return await self._answer(do)

    async def reset(self, parent: ua.NodeId, *given: ua.Variant) -> Answer:
        """Reset the latched fault; what it was, or nothing."""

        async def do() -> str:
            return str((await devices.reset(self._page))["fault"] or "")

        return await self._answer(do)

    async def _answer(self, do: Callable[[], Awaitable[str]]) -> Answer:
        try:
            answer = await do()
        except (Problem, ValidationError, TruestandError, OSError) as wrong:
            why, code = refusal(wrong)
            await self._refuse(why)
            return _code(code)
        await self._refuse("")
        return [ua.Variant(answer, ua.VariantType.String)]


def refusal(wrong: Exception) -> tuple[str, int]:
    """In words and as a status code."""
    if isinstance(wrong, Problem):
        return wrong.message, CODES.get(wrong.status, Codes.BadInternalError)
    if isinstance(wrong, ValidationError):
        first: Any = wrong.errors()[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}", Codes.BadInvalidArgument
    return str(wrong), Codes.BadInvalidArgument if isinstance(wrong, BadRecipe) else Codes.BadInvalidState


def _code(code: int) -> ua.StatusCode:
    return ua.StatusCode(ua.UInt32(code))
