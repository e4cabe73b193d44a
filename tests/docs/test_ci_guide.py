"""docs/ci.md: its workflow, its GitLab job and its hooks are run as the services run them; so is our own workflow."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from support.cli import GOOD, gusjob
from support.documents import blocks, text_of
from support.tools import MARK, ROOT

jsonschema: Any = import_module("jsonschema")
yaml: Any = import_module("yaml")

SCHEMAS = ROOT / "tests" / "schemas"
SARIF = jsonschema.Draft4Validator(json.loads((SCHEMAS / "sarif-schema-2.1.0.json").read_text(encoding="utf-8")))
WORKFLOW = jsonschema.Draft7Validator(json.loads((SCHEMAS / "github-workflow.json").read_text(encoding="utf-8")))
HOOKS = ROOT / ".pre-commit-hooks.yaml"
INSTALL = "python -m pip install GUSJOB"
"""GUSJOB stands for where the reader has gusjob from."""


def write(path: Path, text: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, in which gusjob is called."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for variable in ("GITHUB_WORKSPACE", "CI_PROJECT_DIR"):  # Those of the CI that runs the tests.
        monkeypatch.delenv(variable, raising=False)
    return folder


@pytest.fixture
def shell(tmp_path: Path) -> dict[str, str]:
    """An environment in which `gusjob` is this one, and git asks nobody who it is."""
    tools = tmp_path / "tools"
    tools.mkdir()
    command = tools / "gusjob"
    command.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m gusjob "$@"\n', encoding="utf-8")
    command.chmod(0o755)
    who = {f"GIT_{who}_{what}": "a@b.example" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
    paths = os.pathsep.join([str(tools), os.environ["PATH"]])
    old = {name: value for name, value in os.environ.items() if not name.startswith(("GIT_", "GITHUB_"))}
    return {**old, **who, "PATH": paths, "GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_SYSTEM": os.devnull}


def need_posix(*tools: str) -> None:
    for tool in tools:
        if os.name == "nt" or shutil.which(tool) is None:
            pytest.skip(f"{tool} is missing")


def git(folder: Path, shell: dict[str, str], *args: str) -> None:
    subprocess.run(["git", *args], cwd=folder, env=shell, check=True, capture_output=True)


def committed(folder: Path, shell: dict[str, str], branch: str = "main") -> None:
    """All of a folder as one more commit."""
    if not (folder / ".git").exists():
        git(folder, shell, "init", "--quiet", "--initial-branch", branch)
    git(folder, shell, "add", "--all")
    git(folder, shell, "commit", "--quiet", "--message", "x")


def hooks() -> dict[str, dict[str, Any]]:
    return {hook["id"]: hook for hook in yaml.safe_load(HOOKS.read_text(encoding="utf-8"))}


def test_the_hooks_take_the_files_that_are_theirs() -> None:
    assert set(hooks()) == {"gusjob-check", "gusjob-fmt"}
    for name, wanted in (("gusjob-check", ["a.job", "in/b.JOB", "c.gts"]), ("gusjob-fmt", ["a.job", "in/b.JOB"])):
        hook = hooks()[name]
        names = ["a.job", "in/b.JOB", "c.gts", "d.txt", "e.job.bak", "job", "f.jobs"]
        assert [n for n in names if re.search(hook["files"], n)] == wanted
        assert hook["language"] == "python"


@pytest.mark.parametrize("hook", ["gusjob-check", "gusjob-fmt"])
def test_a_hook_runs(here: Path, hook: str) -> None:
    program, command = shlex.split(hooks()[hook]["entry"])
    assert program == "gusjob"
    assert gusjob(command, write(here / "a.job", GOOD), write(here / "b.job", GOOD)).exit_code == 0
    assert gusjob(command, write(here / "bad.job", "QQ\n")).exit_code == 1


def test_pre_commit_runs_the_hook(tmp_path: Path, shell: dict[str, str]) -> None:
    need_posix("git")
    if find_spec("pre_commit") is None:
        pytest.skip("pre-commit is not installed")
    shell["PRE_COMMIT_HOME"] = str(tmp_path / "home")

    def pre_commit(*args: object) -> subprocess.CompletedProcess[str]:
        called = [sys.executable, "-m", "pre_commit", *map(str, args)]
        return subprocess.run(called, cwd=work, env=shell, capture_output=True, text=True, encoding="utf-8")

    # `language: python` would fetch what gusjob needs; here that stands ready, and no network is asked for.
    text = HOOKS.read_text(encoding="utf-8")
    assert text.count("language: python") == 2
    write(tmp_path / "hooks" / HOOKS.name, text.replace("language: python", "language: system"))
    committed(tmp_path / "hooks", shell)
    work = tmp_path / "work"
    write(work / "a.job", GOOD)
    write(work / "notes.txt", "QQ\n")
    committed(work, shell)
    assert pre_commit("validate-manifest", HOOKS).returncode == 0
    clean = pre_commit("try-repo", tmp_path / "hooks", "gusjob-check", "--all-files", "--verbose")
    assert clean.returncode == 0, clean.stdout + clean.stderr
    assert "1 file: clean" in clean.stdout
    write(work / "in" / "b.gts", "GT_QQ(1)\n")
    committed(work, shell)
    bad = pre_commit("try-repo", tmp_path / "hooks", "gusjob-check", "--all-files")
    assert bad.returncode == 1
    assert "in/b.gts:1:1: error[GJ112]" in bad.stdout
    assert "notes.txt" not in bad.stdout


def read_yaml(text: str) -> Any:
    """A YAML document of GitHub's: in YAML 1.1 a bare `on` is true."""
    return yaml.safe_load(re.sub(r"(?m)^on:", '"on":', text))


def examples() -> list[Any]:
    """The YAML blocks of the guide."""
    return [read_yaml(block) for block in blocks(text_of("docs/ci.md"), "yaml")]


def own_commands(steps: list[str]) -> list[str]:
    """Commands that are ours; the line that installs gusjob is known and left out."""
    ours = [step for step in steps if step != INSTALL]
    assert len(ours) == len(steps) - 1
    assert all("gusjob " in step for step in ours)
    return ours


def test_the_workflow_fits_the_schema() -> None:
    workflow = examples()[0]
    WORKFLOW.validate(workflow)
    assert list(WORKFLOW.iter_errors({**workflow, "jobs": {"gusjob": {"steps": "x"}}}))
    steps = workflow["jobs"]["gusjob"]["steps"]
    sarif_file = next(step["with"]["sarif_file"] for step in steps if "upload-sarif" in step.get("uses", ""))
    assert any(f"-o {sarif_file} " in step.get("run", "") for step in steps)


@pytest.mark.slow
@pytest.mark.parametrize("bad", [False, True])
def test_the_workflow_runs(tmp_path: Path, shell: dict[str, str], bad: bool) -> None:
    need_posix("git", "bash")
    base, checkout, temp = tmp_path / "base", tmp_path / "checkout", tmp_path / "temp"
    temp.mkdir()
    for name in ("co2_cut.job", "manual_direct.job"):
        write(base / "jobs" / name, (ROOT / "jobs" / name).read_bytes())
    write(base / "jobs" / "part.job", GOOD)
    committed(base, shell)
    git(tmp_path, shell, "clone", "--quiet", str(base), str(checkout))
    # The mark is made 15 instead of 5 mm long, and one job is new.
    write(checkout / "jobs" / "part.job", GOOD.replace("LINE X 10", "LINE X 20"))
    write(checkout / "jobs" / "new.job", "QQ\n" if bad else GOOD)
    committed(checkout, shell)
    summary = tmp_path / "summary.md"
    shell |= {"GITHUB_BASE_REF": "main", "RUNNER_TEMP": str(temp), "GITHUB_STEP_SUMMARY": str(summary)}
    steps = examples()[0]["jobs"]["gusjob"]["steps"]
    codes = []
    for command in own_commands([step["run"] for step in steps if "run" in step]):
        called = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", command]  # As the runner calls it.
        done = subprocess.run(called, cwd=checkout, env=shell, capture_output=True, text=True, encoding="utf-8")
        assert done.returncode in (0, 1), done.stderr
        codes.append(done.returncode)
    assert codes == [int(bad), 0]
    log = json.loads((checkout / "gusjob.sarif").read_text(encoding="utf-8"))
    SARIF.validate(log)
    errors = [r["locations"][0] for r in log["runs"][0]["results"] if r["level"] == "error"]
    found = [location["physicalLocation"] for location in errors]
    places = [(one["artifactLocation"]["uri"], one["region"]["startLine"]) for one in found]
    assert places == ([("jobs/new.job", 1)] if bad else [])
    text = summary.read_text(encoding="utf-8")
    parts = {part.split("`")[1]: part for part in re.split(r"(?m)^(?=## `)", text)[1:]}
    assert sorted(parts) == sorted(f"jobs/{path.name}" for path in (checkout / "jobs").glob("*.job"))
    # At 100 mm/s 5 mm take 50 ms and 15 mm 150 ms, each with the same 5 ms of getting up to speed at both ends.
    assert re.search(r"duration.*\b110\b.*\b210\b", parts["jobs/part.job"]), parts["jobs/part.job"]
    assert ("Not run" in parts["jobs/new.job"]) is bad


def test_the_step_with_annotations_runs(here: Path) -> None:
    steps = examples()[1]["steps"]
    WORKFLOW.validate({"on": "push", "jobs": {"gusjob": {"runs-on": "ubuntu-latest", "steps": steps}}})
    write(here / "jobs" / "part.job", MARK + "LASER DELAY ON 20 OFF 10\n")
    (command,) = own_commands([step["run"] for step in steps if "run" in step])
    done = gusjob(*shlex.split(command)[1:])
    assert (done.exit_code, done.stdout.startswith("::warning file=jobs/part.job,line=4,")) == (1, True)


def test_the_gitlab_job_runs(here: Path) -> None:
    job = examples()[2]["gusjob"]
    write(here / "jobs" / "part.job", MARK + "LASER DELAY ON 20 OFF 10\n")
    reporting, checking = own_commands(job["script"])
    assert [gusjob(*shlex.split(command)[1:]).exit_code for command in (reporting, checking)] == [0, 1]
    reports = job["artifacts"]["reports"]
    top = ElementTree.parse(here / reports["junit"]).getroot()
    assert [child.tag for case in top.iter("testcase") for child in case] == ["failure"]
    (finding,) = json.loads((here / reports["codequality"]).read_bytes())
    assert finding["location"] == {"path": "jobs/part.job", "lines": {"begin": 4}}


def test_the_hooks_of_the_guide_are_there() -> None:
    (repo,) = examples()[3]["repos"]
    assert {hook["id"] for hook in repo["hooks"]} <= set(hooks())


def own_workflow() -> Any:
    return read_yaml(text_of(".github/workflows/test.yml"))


def test_our_own_workflow_fits_the_schema() -> None:
    WORKFLOW.validate(own_workflow())


def test_our_own_workflow_tests_every_system_and_version() -> None:
    matrix = own_workflow()["jobs"]["test"]["strategy"]["matrix"]
    assert {name.split("-")[0] for name in matrix["os"]} == {"ubuntu", "windows", "macos"}
    oldest = re.search(r'requires-python = ">=(3\.\d+)"', text_of("pyproject.toml"))
    assert oldest is not None
    assert matrix["python"][0] == oldest[1]
