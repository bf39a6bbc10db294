"""The snippets of the commands' guide for CI: valid by the services' own schemas, and run as far as they run here."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from command import run as vctune
from conftest import DEVICE, FIXED, ROOT, for_passive_hands

SNIPPETS = dict(re.findall(r"```yaml\n# (\S+)\n(.*?)```", (ROOT / "vctune/cli/README.md").read_text(), re.DOTALL))
WORKFLOW, HOOKS = SNIPPETS[".github/workflows/gains.yml"], SNIPPETS[".pre-commit-config.yaml"]


def run(*command, cwd, **env):
    return subprocess.run(
        [str(part) for part in command], cwd=cwd, env={**os.environ, **env}, text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def module(name, *arguments, cwd, **env):
    return run(sys.executable, "-m", name, *arguments, cwd=cwd, **env)


@pytest.fixture(scope="session")
def region(tmp_path_factory):
    """The region of the device."""
    folder = tmp_path_factory.mktemp("region")
    (folder / "device.toml").write_text(for_passive_hands(DEVICE))
    done = vctune("region", "device.toml", "--resolution", "0.03125", cwd=folder)
    assert done.returncode == 0, done.stderr
    return (folder / "results/device/region.json").read_text()


@pytest.fixture
def repository(tmp_path, region):
    """A user's repository with a device, its gains and region, and the snippets."""
    (tmp_path / "device.toml").write_text(for_passive_hands(DEVICE))
    (tmp_path / "results/device").mkdir(parents=True)
    (tmp_path / "results/device/region.json").write_text(region)
    (tmp_path / "gains.toml").write_text(FIXED.format(160.0))
    for name, text in SNIPPETS.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def spoil(repository):
    (repository / "gains.toml").write_text(FIXED.format(80.0))


def steps(repository, path, *, install):
    """Run the workflow's steps in the shell of GitHub's runners until one fails, and return the last."""
    scripts = [step["run"] for step in yaml.safe_load(WORKFLOW)["jobs"]["gains"]["steps"] if "run" in step]
    assert [script.split()[:2] for script in scripts] == [["pip", "install"], ["vctune", "check"]]
    search = f"{path}{os.pathsep}{os.environ['PATH']}"
    for script in scripts if install else scripts[1:]:
        done = run("bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script, cwd=repository, PATH=search)
        if done.returncode:
            break
    return done


@pytest.mark.slow
def test_the_workflow_is_valid(repository):
    arguments = ("--builtin-schema", "vendor.github-workflows", ".github/workflows/gains.yml")
    done = module("check_jsonschema", *arguments, cwd=repository)
    assert done.returncode == 0, done.stdout
    (repository / arguments[-1]).write_text(WORKFLOW.replace("runs-on", "run-on"))
    assert module("check_jsonschema", *arguments, cwd=repository).returncode == 1


def test_the_action_checks(repository):
    """Its last step with the inputs of the guide, in the shell that it names."""
    guide = (ROOT / "vctune/cli/README.md").read_text()
    (used,) = (yaml.safe_load(text)[1] for text in re.findall(r"```yaml\n( +- uses:.*?)```", guide, re.DOTALL))
    folder = used["uses"].removeprefix("./vctune/")
    action = yaml.safe_load((ROOT / folder / "action.yml").read_text())
    assert set(used["with"]) <= set(action["inputs"])
    *_, installing, checking = action["runs"]["steps"]
    assert (ROOT / folder / re.search(r"ACTION_PATH/([./]+)", installing["run"])[1] / "pyproject.toml").exists()
    assert checking["env"] == {"FILES": "${{ inputs.files }}", "OPTIONS": "${{ inputs.options }}"}
    env = {name.upper(): value for name, value in used["with"].items()}
    env["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    shell = ("bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", checking["run"])
    assert run(*shell, cwd=repository, **env).returncode == 0
    spoil(repository)
    done = run(*shell, cwd=repository, **env)
    assert done.returncode == 1 and "::error file=gains.toml,line=2," in done.stdout


def check_the_gate(repository, path, *, install):
    assert steps(repository, path, install=install).returncode == 0
    spoil(repository)
    done = steps(repository, path, install=False)
    assert done.returncode == 1
    assert "::error file=gains.toml,line=2," in done.stdout


@pytest.mark.slow
def test_the_workflow_checks(repository):
    check_the_gate(repository, Path(sys.executable).parent, install=False)


@pytest.mark.slow
def test_the_workflow_guards_the_region(repository):
    """A demand that the gains still meet but part of the region does not."""
    (repository / "device.toml").write_text(for_passive_hands(DEVICE + "[stability]\nmax_sensitivity = 1.8\n"))
    done = steps(repository, Path(sys.executable).parent, install=False)
    assert done.returncode == 1
    (annotation,) = [line for line in done.stdout.splitlines() if line.startswith("::error")]
    assert annotation.startswith("::error file=device.toml,line=1,")
    assert "lost their proof" in annotation
    assert (repository / "results/device/lost.svg").exists()


@pytest.mark.night
def test_the_workflow_installs_and_checks(repository):
    subprocess.run(["git", "clone", "-q", ROOT, "vctune"], cwd=repository, check=True)
    subprocess.run([sys.executable, "-m", "venv", ".venv"], cwd=repository, check=True)
    check_the_gate(repository, repository / ".venv/bin", install=True)


def test_the_hook_is_valid(repository):
    assert module("pre_commit", "validate-manifest", ROOT / ".pre-commit-hooks.yaml", cwd=repository).returncode == 0
    assert module("pre_commit", "validate-config", cwd=repository).returncode == 0


def test_the_hook_checks(repository):
    """What pre-commit would run: the hook's entry with the guide's arguments, when a file that matches is changed."""
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())
    (used,) = yaml.safe_load(HOOKS)["repos"][0]["hooks"]
    assert used["id"] == hook["id"]
    changed = [path.name for path in repository.iterdir() if re.search(hook["files"], path.name)]
    assert sorted(changed) == ["device.toml", "gains.toml"]
    assert hook["pass_filenames"] is False
    name, *command = [*shlex.split(hook["entry"]), *used["args"]]
    assert name == "vctune" and vctune(*command, cwd=repository).returncode == 0
    spoil(repository)
    assert vctune(*command, cwd=repository).returncode == 1


@pytest.mark.night
def test_pre_commit_installs_and_runs_the_hook(repository):
    subprocess.run(["git", "clone", "-q", ROOT, "vctune"], cwd=repository, check=True)
    (repository / ".gitignore").write_text("vctune\n")
    for command in (["git", "init", "-q"], ["git", "add", "."]):
        subprocess.run(command, cwd=repository, check=True)
    home = {"PRE_COMMIT_HOME": str(repository / ".git/pre-commit")}
    done = module("pre_commit", "run", "--all-files", cwd=repository, **home)
    assert done.returncode == 0, done.stdout
    assert "Passed" in done.stdout
    spoil(repository)
    subprocess.run(["git", "add", "."], cwd=repository, check=True)
    done = module("pre_commit", "run", "--all-files", cwd=repository, **home)
    assert done.returncode == 1
    assert "gains.toml: refuted" in done.stdout


ARM = """[device]
sample_time = 2e-3
servo = { delay = 0.01, bandwidth_hz = 8.0 }
[operator]
stiffness = 500.0
[coupling]
damping = inf
mass = 5.0
drag = 90.0
"""
DEVICE_FILE, GAINS, REGION, ROS = "device.toml", "gains.toml", "results/device/region.json", "arm.yaml"
CONFLICT = "<<<<<<< HEAD\n{0}=======\n{0}>>>>>>> tuning\n"


def swap(old, new):
    def edit(text):
        assert old in text
        return text.replace(old, new, 1)

    return edit


def of_region(change):
    """A change of a file without its digest, as an earlier version wrote it: the digest alone would show any."""

    def edit(text):
        record = json.loads(text)
        del record["sha256"]
        change(record)
        return json.dumps(record)

    return edit


def flipped(record, *, areas):
    """An infeasible cell that a merge made feasible."""
    cell = max((cell for cell in record["cells"] if cell[4] == "infeasible"), key=lambda cell: cell[1] - cell[0])
    share = (cell[1] - cell[0]) * (cell[3] - cell[2]) / (len(record["edges"]["x"]) - 1) ** 2
    cell[4:] = ["feasible", next(cell[5] for cell in record["cells"] if cell[4] == "feasible")]
    if areas:
        record["areas"]["feasible"] += share
        record["areas"]["infeasible"] -= share


EDITS = [
    *((name, "a comment", lambda text: "# measured again\n" + text, 0) for name in (DEVICE_FILE, GAINS, ROS)),
    *((name, "windows", lambda text: "\ufeff" + text.replace("\n", "\r\n"), 0) for name in (DEVICE_FILE, GAINS)),
    *((name, "emptied", lambda text: "", 2) for name in (DEVICE_FILE, GAINS, REGION, ROS, "arm.toml")),
    *((name, "cut", lambda text: text[: len(text) * 2 // 3], 2) for name in (DEVICE_FILE, GAINS, REGION)),
    *((name, "conflict", CONFLICT.format, 2) for name in (DEVICE_FILE, GAINS, REGION, ROS)),
    *((name, "removed", lambda text: None, 2) for name in (DEVICE_FILE, GAINS, REGION, ROS)),
    *((name, "latin", lambda text: text + "# \udcff", 2) for name in (DEVICE_FILE, GAINS, ROS)),
    (GAINS, "a little more damping", swap("160.0", "161.0"), 0),
    (GAINS, "a little less damping", swap("160.0", "159.5"), 0),
    (GAINS, "half the damping", swap("160.0", "80.0"), 1),
    (GAINS, "no integrator", swap("position = 6000.0", "position = 0.0"), 0),
    (GAINS, "ten times the integrator", swap("6000.0", "60000.0"), 1),
    (GAINS, "no position", swap("position = 6000.0\n", ""), 2),
    (GAINS, "no table", swap("[coupling]\n", ""), 2),
    (GAINS, "a key twice", swap("velocity = 150.0", "velocity = 150.0\nvelocity = 80.0"), 2),
    (GAINS, "not TOML", swap("velocity =", "velocity:"), 2),
    (GAINS, "the problem", lambda text: DEVICE, 2),
    (DEVICE_FILE, "a name", lambda text: 'name = "handle"\n' + text, 0),
    (DEVICE_FILE, "delay", swap("sample_time", "delay = 2e-4\nsample_time"), 1),
    (DEVICE_FILE, "slower", swap("1e-3", "2e-3"), 1),
    (DEVICE_FILE, "heavier", swap("0.4", "0.8"), 1),
    (DEVICE_FILE, "a stricter factor", swap("[stability]", "[stability]\nsafety_factor = 1.5"), 1),
    (DEVICE_FILE, "no mass", swap("mass = 0.4\n", ""), 2),
    (DEVICE_FILE, "another kind", swap("[device]", '[device]\ndisplay = "impedance"'), 2),
    (DEVICE_FILE, "the gains", lambda text: FIXED.format(160.0), 2),
    (REGION, "no cells", of_region(lambda record: record["cells"].clear()), 2),
    (REGION, "no cells and areas", of_region(lambda record: (record["cells"].clear(), record["areas"].clear())), 2),
    (REGION, "half the cells", of_region(lambda record: record["cells"].__delitem__(slice(5, None))), 2),
    (REGION, "a cell of a merge", of_region(lambda record: flipped(record, areas=False)), 2),
    (REGION, "a cell and its area", of_region(lambda record: flipped(record, areas=True)), 1),
    (REGION, "poor gains", of_region(lambda record: record["designs"][0]["coupling"].update(damping=1.0)), 1),
    (ROS, "more damping", swap("joint_damping: ", "joint_damping: 1"), 0),
    (ROS, "less damping", swap("joint_damping: ", "joint_damping: 0.1 #"), 1),
    (ROS, "another rate", lambda text: text.replace("parameters:\n", "parameters:\n    update_rate: 100\n"), 2),
    (ROS, "no mass", lambda text: re.sub(r" +mass: .*\n", "", text), 2),
    ("arm.toml", "later", swap("0.01", "0.4"), 1),
]  # fmt: skip


@pytest.mark.night
def test_a_year_of_edits(repository):
    """No wrong thing passes and no right thing fails, each change of the repository on its own; a mistake in a file is
    one error."""
    (repository / "arm.toml").write_text(ARM)
    assert vctune("export", "arm.toml", "--to", "ros2", cwd=repository).returncode == 0
    (repository / "results/arm/firmware/admittance_controller.yaml").rename(repository / ROS)
    for command in (["init", "-q"], ["add", "."]):
        subprocess.run(["git", *command], cwd=repository, check=True)
    *_, step = yaml.safe_load(WORKFLOW)["jobs"]["gains"]["steps"]
    robot = ["check", "arm.toml", ROS, "--format", "github"]
    answers = {}
    for name, what, edit, code in EDITS:
        text = edit((repository / name).read_text())
        if text is None:
            (repository / name).rename(repository / f"renamed-{Path(name).name}")
        else:
            (repository / name).write_bytes(text.encode("utf-8", "surrogateescape"))
        done = vctune(*(robot if "arm" in name else shlex.split(step["run"])[1:]), cwd=repository)
        subprocess.run(["git", "checkout", "-q", "."], cwd=repository, check=True)
        errors = re.findall(r"^::error file=(.*?),", done.stdout, re.MULTILINE)
        if done.returncode != code or bool(errors) != (code > 0) or (code == 2 and len({*errors}) < len(errors)):
            answers[f"{name}: {what}"] = (done.returncode, code, done.stdout, done.stderr)
    assert answers == {}
