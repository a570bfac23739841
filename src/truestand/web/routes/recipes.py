"""Stand, artefact and parts as texts that can be read, checked and saved."""

from typing import Any

from starlette.concurrency import run_in_threadpool

from truestand.web.app_state import Page, ThePage
from truestand.web.checking import is_heavy, problem_of
from truestand.web.models import Checked, Part, Recipe, RecipeBody, RecipeText
from truestand.web.problem import Problem
from truestand.web.routing import Doors, Policy

BODY = 260_000
"""Bytes: a recipe of 200,000 characters, escaped."""


def add(doors: Doors) -> None:
    """Register."""
    operator, engineer = Policy("operator"), Policy("engineer", body=BODY)
    doors.add("GET", "/api/parts", parts, operator, "Parts that can be inspected", response_model=list[Part])
    doors.add("GET", "/api/recipes", recipes, operator, "All recipes of the stand", response_model=list[Recipe])
    one = "/api/recipes/{file}"
    doors.add("GET", one, recipe, operator, "A recipe's text", (404,), response_model=RecipeText)
    doors.add("POST", f"{one}/check", check, engineer, "What is wrong with a text", (404,), response_model=Checked)
    doors.add("PUT", one, save, engineer, "Save a recipe that has no problem", (404, 409), response_model=Checked)


def parts(page: ThePage) -> list[dict[str, Any]]:
    """Every recipe with a kind."""
    return parts_of(page)


def parts_of(page: Page) -> list[dict[str, Any]]:
    """The parts of the stand's folder."""
    return [
        {"name": r.name, "title": r.title, "kind": r.part_kind, "file": r.file}
        for r in page.folder.recipes()
        if r.kind == "part" and r.part_kind
    ]


def recipes(page: ThePage) -> list[dict[str, Any]]:
    """By file name."""
    return [{"file": r.file, "kind": r.kind, "title": r.title} for r in page.folder.recipes()]


async def recipe(file: str, page: ThePage) -> dict[str, Any]:
    """With what is wrong with it, if anything."""
    text = await run_in_threadpool(page.folder.read, file)
    return {"file": file, "text": text, "problem": await _problem(page, file, text)}


async def check(file: str, body: RecipeBody, page: ThePage) -> dict[str, Any]:
    """Nothing is written."""
    await run_in_threadpool(page.folder.file, file)
    return {"problem": await _problem(page, file, body.text)}


async def save(file: str, body: RecipeBody, page: ThePage) -> dict[str, Any]:
    """As a whole, and only where it is right; not while a job may read it."""
    await run_in_threadpool(page.folder.file, file)
    _demand_idle(page)
    problem = await _problem(page, file, body.text)
    if problem is not None:
        raise Problem(422, problem)
    async with page.recipes:
        _demand_idle(page)  # a job may have started while the text was checked
        await run_in_threadpool(page.folder.write, file, body.text)
    return {"problem": None}


def _demand_idle(page: Page) -> None:
    if page.runner.busy:
        raise Problem(409, "found a job running, need it ended before recipes change; wait for it or abort it")


async def _problem(page: Page, file: str, text: str) -> str | None:
    if not await run_in_threadpool(is_heavy, text):
        return await run_in_threadpool(problem_of, page.folder.path, file, text)
    found = await page.ask("check", str(page.folder.path), file, text=text)
    return None if found is None else str(found)
