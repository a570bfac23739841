"""Bodies of requests and answers: the page's REST interface as /api/openapi.json documents it."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from truestand.store.standing import Standing
from truestand.web.authentication import Role

JobKind = Literal["calibrate", "inspect", "verify"]
Text = Annotated[str, Field(max_length=120)]


class Body(BaseModel):
    """A request's body: no unknown key."""

    model_config = ConfigDict(extra="forbid")


class LoginBody(Body):
    """A login."""

    user: Text
    password: Annotated[str, Field(max_length=1024)]


class JobBody(Body):
    """A job to start."""

    kind: JobKind
    part: Text | None = None
    operator: Text | None = None
    order: Text | None = None
    serial: Text | None = None


class RecipeBody(Body):
    """A recipe's new text."""

    text: Annotated[str, Field(max_length=200_000)]


class WithdrawBody(Body):
    """Why a result is taken back."""

    reason: Annotated[str, Field(min_length=1, max_length=300)]
    operator: Text | None = None


class ProblemBody(BaseModel):
    """Any refusal: what was found, what is needed, what to do."""

    problem: str


class SessionInfo(BaseModel):
    """Who asks, and what a page needs to know at first."""

    user: str | None
    role: Role | None
    login_needed: bool
    csrf: str
    company: str
    version: str
    stand: str


class Part(BaseModel):
    """A part that can be inspected."""

    name: str
    title: str
    kind: Literal["gear", "turned", "cad"]
    file: str


class Step(BaseModel):
    """One step of a job."""

    name: str
    label: str
    state: Literal["waiting", "running", "done", "failed"]


class Job(BaseModel):
    """A job, running or over."""

    id: str
    kind: JobKind
    part: str | None
    title: str
    state: Literal["running", "done", "failed", "aborted"]
    step: str | None
    steps: list[Step]
    done: float
    message: str
    number: int | None
    verdict: str | None
    status: str | None


class AvailableFiles(BaseModel):
    """What can be fetched of a result."""

    report: bool
    cloud: bool
    certificate: bool


class Entry(BaseModel):
    """One result of the store."""

    number: int
    kind: str
    time: str
    operator: str | None
    order: str | None
    serial: str | None
    part: str | None
    title: str
    verdict: str | None
    status: str | None
    corrects: int | None
    corrected_by: int | None
    standing: Standing
    """What it is worth today: ``in_doubt`` for its ``doubts``, ``corrected`` or ``withdrawn`` by a later entry."""
    doubts: list[str]
    """What became of the calibration that it rests on, where that speaks against it."""
    has: AvailableFiles


class CalibrationState(BaseModel):
    """What the stand's calibration in force is worth."""

    state: Literal["valid", "untrusted", "does_not_hold", "expired", "undecided", "changed", "none"]
    """``does_not_hold`` and ``undecided`` are what a verification of it found; ``changed``: see ``changes``."""
    number: int | None = None
    time: str | None = None
    valid_until: str | None = None
    reasons: list[str] = []
    """Of the verification, where the state is what it found; of the calibration otherwise."""
    verification: int | None = None
    """Number of the verification that counts."""
    verified: str | None = None
    """When that was."""
    changes: list[str] = []
    """In what stand.toml and shaft.toml differ today from what it was made with."""
    not_in_force: int | None = None
    """Number of the newest calibration, where it is not used."""
    not_in_force_reason: str | None = None
    """Why: not trusted, of another stand, of a method that can inspect nothing."""


class Home(BaseModel):
    """The first view."""

    calibration: CalibrationState
    last: list[Entry]
    job: Job | None
    fault: str | None
    not_stopped: list[str]
    """What the fault left on or moving: *Laser may be ON* and the like, in plain words."""
    parts: list[Part]
    version: str
    """Another one whenever anything here but the job has changed, or the store; the live channel says so."""


class Result(BaseModel):
    """One result with its record."""

    entry: Entry
    record: dict[str, Any]


class Point(BaseModel):
    """One value of a trend."""

    number: int
    time: str
    value: float
    U: float | None


class TrendFinding(BaseModel):
    """What a control chart says."""

    number: int
    text: str


class Quantity(BaseModel):
    """One quantity over time, with its limits."""

    name: str
    label: str
    unit: str
    points: list[Point]
    centre: float | None
    lower: float | None
    upper: float | None
    limit: float | None = None
    """The drawing's, of a deviation: the upper one, or the only one."""
    limits: tuple[float | None, float | None] | None = None
    """The drawing's, lower and upper; null: that side is open."""
    findings: list[TrendFinding] = []


class History(BaseModel):
    """Trends."""

    quantities: list[Quantity]


class Recipe(BaseModel):
    """A file of the stand's folder."""

    file: str
    kind: Literal["stand", "artefact", "part"]
    title: str


class RecipeText(BaseModel):
    """A recipe as it stands."""

    file: str
    text: str
    problem: str | None


class Checked(BaseModel):
    """What is wrong with a recipe; null: nothing."""

    problem: str | None


class Device(BaseModel):
    """What a device says when it is asked."""

    device: str
    name: str
    address: str
    answers: bool
    problem: str | None
    told: dict[str, str]


class Reset(BaseModel):
    """The fault that was cleared; null where there was none."""

    fault: str | None


class AuditFinding(BaseModel):
    """Something of the store that isn't as it was."""

    what: str
    where: str


class Audit(BaseModel):
    """What an audit of the store found."""

    findings: list[AuditFinding]
