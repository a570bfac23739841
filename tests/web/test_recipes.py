"""Recipes are files of one folder, and no name leads anywhere else."""

import asyncio
import os
import threading

import pytest

from truestand.web.authentication import Principal
from truestand.web.models import JobBody, RecipeBody
from truestand.web.problem import Problem
from truestand.web.recipes import RecipeFolder
from truestand.web.routes import jobs, recipes
from web_lab import Client, make_state, served, snapshot

OUTSIDE = [
    "../secret.toml", "..%2fsecret.toml", "%2e%2e/secret.toml", "..\\secret.toml", "/etc/passwd.toml",
    "a/../../secret.toml",
    "../stand-other/secret.toml", "..", ".", ".hidden.toml", "sub/inner.toml", "secret.toml/", "gear.toml\x00.png",
    "gear.TOML.txt", "gear", "C:secret.toml", "C:\\secret.toml", "\\\\host\\share.toml", "~.toml", "gear.toml\n",
    "nul\r\n.toml", "a" * 300 + ".toml", "..toml", "gear..toml", "‥/secret.toml", "．．/secret.toml",
]  # fmt: skip


HOLD = {"kind": "calibrate", "serial": "long"}


@pytest.fixture
def stand(tmp_path):
    """A stand's folder, a sibling whose name begins alike, and a file above."""
    folder = tmp_path / "stand"
    folder.mkdir()
    (tmp_path / "stand-other").mkdir()
    for place in (tmp_path, tmp_path / "stand-other", folder):
        (place / "secret.toml").write_text('kind = "gear"\nname = "secret"\n')
    (folder / "secret.toml").rename(folder / "gear.toml")
    (folder / "sub").mkdir()
    (folder / "sub" / "inner.toml").write_text("x = 1")
    return RecipeFolder(folder)


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_name_that_leads_elsewhere_is_no_recipe(stand, name):
    before = snapshot(stand.path.parent)
    for use in (stand.file, stand.read, lambda n: stand.write(n, "x = 1")):
        with pytest.raises(Problem) as refused:
            use(name)
        assert refused.value.status_code == 404
    assert snapshot(stand.path.parent) == before


@pytest.mark.parametrize("name", [n for n in OUTSIDE if "\x00" not in n])
@pytest.mark.parametrize("method", ["GET", "PUT"])
def test_a_name_that_leads_elsewhere_is_refused_over_http(stand, name, method):
    from urllib.parse import quote

    folder = stand.path.with_name("page")
    folder.mkdir()
    with served(make_state(folder)) as port:
        client = Client(port)
        client.session()
        before = snapshot(stand.path.parent)
        for path in {quote(name), quote(name, safe=""), quote(quote(name, safe=""), safe="")}:
            answer = client.ask(method, f"/api/recipes/{path}", {"text": "x = 1"} if method == "PUT" else None)
            assert answer.status in (404, 405, 422), answer.body
            assert b"secret" not in answer.body or b"problem" in answer.body
        assert snapshot(stand.path.parent) == before


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_links_are_not_followed(stand):
    outside = stand.path.parent / "secret.toml"
    (stand.path / "link.toml").symlink_to(outside)
    (stand.path / "up.toml").symlink_to(stand.path.parent, target_is_directory=True)
    (stand.path / "dangling.toml").symlink_to(stand.path.parent / "made.toml")
    for name in ("link.toml", "up.toml", "dangling.toml"):
        for use in (stand.read, lambda n: stand.write(n, "x = 1")):
            with pytest.raises(Problem, match="no plain file"):
                use(name)
    assert [r.file for r in stand.recipes()] == ["gear.toml"]
    assert outside.read_text().startswith("kind") and not (stand.path.parent / "made.toml").exists()


@pytest.mark.skipif(os.name == "nt", reason="no such files there")
def test_pipes_and_devices_are_not_read(stand):
    os.mkfifo(stand.path / "pipe.toml")
    with pytest.raises(Problem):
        stand.read("pipe.toml")
    assert len(stand.recipes()) == 1


@pytest.mark.parametrize("name", ["gear.toml", "Zahnrad größer 7.toml", "a-b_c+1.2.toml", "齿轮.toml"])
def test_plain_names_are_recipes(stand, name):
    stand.write(name, 'kind = "gear"\n')
    assert stand.read(name) == 'kind = "gear"\n'
    assert name in [r.file for r in stand.recipes()]


def test_files_that_are_no_recipes_are_not_listed(stand):
    (stand.path / "pyproject.toml").write_text("[tool]\n")
    (stand.path / "broken.toml").write_text("kind = ")
    (stand.path / "huge.toml").write_text("#" * 300_000)
    assert [(r.file, r.kind) for r in stand.recipes()] == [("broken.toml", "part"), ("gear.toml", "part")]
    with pytest.raises(Problem, match="larger"):
        stand.read("huge.toml")


ESCAPES = ["../pyproject.toml", "%2e%2e/routing.py", "..%2frouting.py", "js/../../routing.py", "/etc/passwd",
           ".git/config", "static/../app.py", "__init__.py", "index.html/..", "js"]  # fmt: skip


@pytest.mark.parametrize("name", ESCAPES)
def test_the_pages_own_files_are_looked_up_not_resolved(client, name):
    assert client.get(f"/{name}").status == 404


def test_recipes_are_listed_read_checked_and_saved(client, tmp_path):
    listed = {r["file"]: r["kind"] for r in client.get("/api/recipes").json}
    assert listed == {"stand.toml": "stand", "shaft.toml": "artefact", "gear.toml": "part"}
    assert client.get("/api/parts").json == [
        {"name": "gear", "title": "demo wheel", "kind": "gear", "file": "gear.toml"}
    ]
    payload = client.get("/api/recipes/gear.toml").json
    assert payload["problem"] is None
    wrong = payload["text"].replace("teeth = 24", "tooth = 24")
    before = snapshot(tmp_path)
    found = client.post("/api/recipes/gear.toml/check", {"text": wrong}).json["problem"]
    assert found == "unknown key 'tooth'; did you mean 'teeth'?"
    refused = client.ask("PUT", "/api/recipes/gear.toml", {"text": wrong})
    assert refused.status == 422 and refused.problem == found
    assert snapshot(tmp_path) == before
    saved = client.ask("PUT", "/api/recipes/pinion.toml", {"text": payload["text"].replace("demo wheel", "pinion")})
    assert saved.status == 200 and saved.json == {"problem": None}
    assert (tmp_path / "pinion.toml").exists() and len(client.get("/api/parts").json) == 2
    assert client.get("/api/recipes/none.toml").status == 404


WRONG = [
    ("", "no recipe"),
    ("x = ", "TOML"),
    ('kind = "cad"\nfile = "no.stl"', "no.stl"),
    ("[[cylinder]]\n", "missing"),
    ("[[sensor]]\npoint = 3\n", "points"),
    ("[[sensor]]\n[devices]\nx = 1\n", "devices"),
    ("\x00", "TOML"),
]


@pytest.mark.parametrize(("text", "word"), WRONG)
def test_the_problem_of_a_recipe_is_one_line(client, text, word, tmp_path):
    found = client.post("/api/recipes/new.toml/check", {"text": text}).json["problem"]
    assert word in found and "\n" not in found.strip() and "/tmp/tmp" not in found
    assert not (tmp_path / "new.toml").exists()


def test_a_cad_model_beside_the_recipe_is_found(client, tmp_path):
    import trimesh

    trimesh.creation.box((10, 10, 10)).export(tmp_path / "box.stl")
    checked = client.post("/api/recipes/box.toml/check", {"text": 'kind = "cad"\nfile = "box.stl"\n'})
    assert checked.json == {"problem": None}


def test_saving_a_recipe_while_a_job_runs_is_refused(client):
    job = client.post("/api/jobs", {"kind": "calibrate", "serial": "long"}).json
    text = client.get("/api/recipes/gear.toml").json["text"]
    assert client.ask("PUT", "/api/recipes/gear.toml", {"text": text}).status == 409
    client.post(f"/api/jobs/{job['id']}/abort")


def test_a_recipe_is_not_saved_where_a_job_started_while_it_was_checked(client, tmp_path, monkeypatch):
    begun = []

    def check(folder, name, text):
        begun.append(Client(client.port, client.cookie, client.csrf).post("/api/jobs", HOLD).json["id"])

    text = client.get("/api/recipes/gear.toml").json["text"]
    monkeypatch.setattr(RecipeFolder, "problem_of", check)
    answer = client.ask("PUT", "/api/recipes/gear.toml", {"text": text.replace("demo wheel", "another")})
    assert answer.status == 409 and "job running" in answer.problem
    assert (tmp_path / "gear.toml").read_text(encoding="utf-8") == text
    client.post(f"/api/jobs/{begun[0]}/abort")


def test_a_job_does_not_start_while_a_recipe_is_written(state, monkeypatch):
    writing, go, write = threading.Event(), threading.Event(), RecipeFolder.write

    def slow(folder, name, text):
        writing.set()
        go.wait(20)
        write(folder, name, text)

    async def meet():
        text = state.folder.read("shaft.toml").replace("shaft M", "shaft N")
        saving = asyncio.create_task(recipes.save("shaft.toml", RecipeBody(text=text), state))
        await asyncio.to_thread(writing.wait, 20)
        starting = asyncio.create_task(jobs.start(JobBody(kind="calibrate"), state, Principal(None, "engineer")))
        for _ in range(20):
            await asyncio.sleep(0)
        assert state.runner.current() is None
        go.set()
        assert ((await saving).problem, (await starting)["title"]) == (None, "shaft N")

    monkeypatch.setattr(RecipeFolder, "write", slow)
    try:
        asyncio.run(meet())
    finally:
        go.set()
        state.runner.close()
