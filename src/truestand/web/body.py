"""A request's body: read whole before anything is made of it, within its route's limit, and in time."""

import asyncio

from starlette.requests import Request
from starlette.types import Message, Receive

from truestand.web.problem import Problem

SLOWEST = 15.0
"""s for a body as a whole."""


async def with_body(request: Request, limit: int) -> Request:
    """The same request with its body, of at most ``limit`` bytes, already there.

    Raises:
        Problem: 413 too large, 408 too slow.
    """
    stated = request.headers.get("content-length", "0")
    chunked = "transfer-encoding" in request.headers
    if (stated.isdecimal() and int(stated) > limit) or (chunked and limit == 0):
        raise _too_large(limit)
    whole = Request(request.scope, _limited(request.receive, limit))
    if limit > 0:
        try:
            async with asyncio.timeout(SLOWEST):
                await whole.body()
        except TimeoutError:
            raise Problem(408, f"found a body slower than {SLOWEST:g} s, need it at once; try again") from None
    return whole


def _limited(receive: Receive, limit: int) -> Receive:
    size = 0

    async def limited() -> Message:
        nonlocal size
        message = await receive()
        size += len(message.get("body", b""))
        if size > limit:
            raise _too_large(limit)
        return message

    return limited


def _too_large(limit: int) -> Problem:
    return Problem(413, f"found a body of more than {limit} bytes, need {'less' if limit else 'none'}; shorten it")
