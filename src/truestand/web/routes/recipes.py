"""Stand, artefact and parts as texts that can be read, checked and saved."""

from dataclasses import replace

from starlette.concurrency import run_in_threadpool

from truestand.web.app_state import AppState, StateDep
from truestand.web.models import Checked, Part, Recipe, RecipeBody, RecipeText
from truestand.web.problem import Problem
from truestand.web.recipes import loads_model
from truestand.web.routing import ENGINEER, OPERATOR, Routes

EDITING = replace(ENGINEER, max_body_bytes=260_000)
"""A recipe of 200,000 characters, escaped."""
RECIPE = "/api/recipes/{file}"
routes = Routes()


@routes.add("GET", "/api/parts", OPERATOR, "Parts that can be inspected")
def parts(state: StateDep) -> list[Part]:
    """Every recipe with a kind."""
    return [
        Part(name=r.name, title=r.title, kind=r.part_kind, file=r.file) for r in state.folder.recipes() if r.part_kind
    ]


@routes.add("GET", "/api/recipes", OPERATOR, "All recipes of the stand")
def recipes(state: StateDep) -> list[Recipe]:
    """By file name."""
    return [Recipe(file=r.file, kind=r.kind, title=r.title) for r in state.folder.recipes()]


@routes.add("GET", RECIPE, OPERATOR, "A recipe's text", (404,))
async def recipe(file: str, state: StateDep) -> RecipeText:
    """With what is wrong with it, if anything."""
    text = await run_in_threadpool(state.folder.read, file)
    return RecipeText(file=file, text=text, problem=await _problem(state, file, text))


@routes.add("POST", f"{RECIPE}/check", EDITING, "What is wrong with a text", (404,))
async def check(file: str, body: RecipeBody, state: StateDep) -> Checked:
    """Nothing is written."""
    await run_in_threadpool(state.folder.file, file)
    return Checked(problem=await _problem(state, file, body.text))


@routes.add("PUT", RECIPE, EDITING, "Save a recipe that has no problem", (404, 409))
async def save(file: str, body: RecipeBody, state: StateDep) -> Checked:
    """As a whole, and only where it is right; not while a job may read it."""
    await run_in_threadpool(state.folder.file, file)
    _require_idle(state)
    problem = await _problem(state, file, body.text)
    if problem is not None:
        raise Problem(422, problem)
    async with state.recipe_lock:
        _require_idle(state)  # a job may have started while the text was checked
        await run_in_threadpool(state.folder.write, file, body.text)
    return Checked(problem=None)


def _require_idle(state: AppState) -> None:
    if state.runner.busy:
        raise Problem(409, "found a job running, need it ended before recipes change; wait for it or abort it")


async def _problem(state: AppState, file: str, text: str) -> str | None:
    if not await run_in_threadpool(loads_model, text):
        return await run_in_threadpool(state.folder.problem_of, file, text)
    problem: str | None = await state.run_task("check", str(state.folder.path), file, text=text)
    return problem
