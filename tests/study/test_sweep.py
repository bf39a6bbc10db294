"""Sweeps: rows that outlive any death, the same from every kind of worker."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from math import isnan

import psutil
import pytest
from command import on_a_full_disk, run, started, wait_until, without_progress
from hypothesis import given
from hypothesis import strategies as st

from vctune.design.solve import solve
from vctune.document.reading import parse_problem, read_problem
from vctune.document.study_file import read_study
from vctune.document.text.errors import InputError
from vctune.exit_codes import ExitCode
from vctune.study import sweep as sweeping
from vctune.study.executors import worker_pool
from vctune.study.rows import key_of, open_rows
from vctune.study.study_table import csv_text, table_of
from vctune.study.sweep import solve_point, sweep

FREE = (
    "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
    "[stability]\ncriterion = 'passive'\nband_hz = [0.5, 100.0]\n"
)
DAMPING = "device.damping [N s/m]"
"""The heading of its column."""
FIXED = FREE + ("[gains]\nvelocity = 300.0\nposition = 3000.0\n[coupling]\ndamping = 100.0\nmass = 1.0\ndrag = 0.1\n")
"""Judged, not solved: a few milliseconds a point."""
FEW = '"device.damping" = [1.0, 2.0, 4.0]\n"stability.band_hz[1]" = [50.0, 600.0]\n'
MANY = '"device.damping" = {{ log = [0.1, 10.0], n = {0} }}\n"device.mass" = {{ log = [0.1, 1.0], n = {0} }}\n'


def write_study(folder, axes, problem=FREE, name="study"):
    folder.mkdir(exist_ok=True)
    (folder / "device.toml").write_text(problem)
    path = folder / f"{name}.toml"
    path.write_text(f'problem = "device.toml"\n[axes]\n{axes}')
    return path


def rows_in(path):
    """Return the rows of a file by key, without the seconds they took; every line must be whole, no key twice."""
    header, *lines = path.read_text().splitlines()
    assert json.loads(header)["schema"] == "vctune/rows/3"
    rows = {}
    for line in lines:
        row = json.loads(line)
        assert row["key"] not in rows
        assert list(row)[-1] == "seconds" and row.pop("seconds") >= 0
        rows[row["key"]] = json.dumps(row)
    return rows


def swept(path, folder, *, jobs=1, executor=None, restart=False):
    plan = read_study(path)
    with (
        worker_pool(executor or ("processes" if jobs > 1 else "serial"), jobs) as pool,
        open_rows(folder / "rows.jsonl", plan, restart=restart) as rows,
    ):
        return table_of(plan, rows, sweep(plan, rows, pool))


def test_a_row_is_what_solve_says_of_the_point(tmp_path):
    path = write_study(tmp_path, FEW)
    done = run("sweep", path, "--format", "json", cwd=tmp_path)
    assert done.returncode == ExitCode.OK and done.stderr == ""
    found = json.loads(done.stdout, parse_constant=pytest.fail)
    assert found["points"] == 6 and found["status"] == {"certified": 3, "invalid": 3}
    folder = tmp_path / "results" / "study"
    with (folder / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row[DAMPING], row["stability.band_hz[1]"]) for row in rows[:3]] == [
        ("1.0", "50.0"), ("1.0", "600.0"), ("2.0", "50.0"),
    ]  # fmt: skip
    errors = []
    for row in rows:
        if row["stability.band_hz[1]"] == "600.0":
            assert row["status"] == "invalid" and row["error"] == "" and "Nyquist" in row["reason"]
            continue
        text = FREE.replace("2.0", row[DAMPING]).replace("100.0", "50.0")
        judgement = solve(parse_problem(text, "x", "x")).judgement
        assert float(row["error"]) == judgement.transparency.error and row["reason"] == ""
        assert float(row["velocity_gain [N s/m]"]) == judgement.gains.velocity
        assert float(row["coupling_mass [kg]"]) == judgement.coupling.mass
        errors.append(float(row["error"]))
    assert found["best"]["error"] == min(errors) and found["worst"]["error"] == max(errors)
    corner = found["corner"]
    assert corner["points"] == 3 and corner["share"] == 1.0
    assert corner["low"] == {"device.damping": 1.0, "stability.band_hz[1]": 600.0}
    assert {file.name for file in folder.iterdir()} == {"rows.jsonl", "table.csv", "error.svg"}
    assert {"coupling_damping [N s/m]", "worst_hz", "status"} < {*rows[0]} and len({*rows[0]}) == len(rows[0])


WALL = """[device]
display = "impedance"
units = "rotary"
mass = 5e-4
damping = 1e-3
friction = 0.02
sample_time = 1e-3
velocity = { resolution = 3.1416e-4 }
[environment]
stiffness = inf
[operator]
mass = { max = 5e-4 }
damping = { max = 0.05 }
stiffness = { max = 5.0 }
[stability]
criterion = "hands"
[coupling]
stiffness = 127.32365
damping = 0.811153
"""


def test_a_point_that_buzzes_is_not_best_beside_one_that_does_not(tmp_path):
    """The softer wall has the greater error. Alone, the wall that buzzes is the best, and is said to buzz."""
    both = write_study(tmp_path, '"coupling.stiffness" = [127.32365, 20.0]\n"coupling.damping" = [0.811153, 0.1]', WALL)
    both.write_text(both.read_text() + '\n[sample]\nkind = "list"\n')
    found = json.loads(run("sweep", both, "--format", "json", cwd=tmp_path).stdout)
    assert found["best"]["kicks_moving"] == 0 and found["best"]["coupling.stiffness"] == 20.0
    alone = write_study(tmp_path, '"coupling.stiffness" = [127.32365]', WALL, "alone")
    told = run("sweep", alone, cwd=tmp_path).stdout
    assert re.search(r"best +error 0\.0014\d* .*, buzzes after \d+% of its kicks", told)


def test_an_infeasible_point_is_a_row_with_its_reason(tmp_path):
    narrow = "[gains]\nvelocity = 50.0\nposition = 3000.0\n[coupling]\ndamping = { min = 1e-3, max = 5.0 }\n"
    (tmp_path / "device.toml").write_text(FREE + narrow)
    path = tmp_path / "study.toml"
    path.write_text('problem = "device.toml"\n[axes]\n"stability.max_sensitivity" = [2.0]')
    done = run("sweep", path, "--executor", "serial", cwd=tmp_path)
    assert done.returncode == ExitCode.FAILED
    assert "1 infeasible" in done.stdout and "most often: " in done.stdout
    row = json.loads((tmp_path / "results/study/rows.jsonl").read_text().splitlines()[1])
    assert row["reason"] == solve(read_problem(tmp_path / "device.toml").problem).infeasibility.reason
    assert row["error"] is None


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Return the study and the bytes of everything that one job made of it, with IPOPT and without a neighbour."""
    folder = tmp_path_factory.mktemp("reference")
    path = write_study(folder, '"device.damping" = { log = [0.5, 5.0], n = 4 }\n"device.delay" = [0.0, 3e-4, 1e-3]\n')
    table = swept(path, folder, jobs=1)
    return path, rows_in(folder / "rows.jsonl"), csv_text(table)


def test_weights_of_the_error_do_not_change_what_is_infeasible(tmp_path, monkeypatch):
    """One search answers for all weights, and each row is what a search of its own would say."""
    solved = []

    def counted(problem, time_limit):
        solved.append(problem)
        return solve_point(problem, time_limit)

    monkeypatch.setattr(sweeping, "solve_point", counted)
    narrow = FREE + "[gains]\nvelocity = 50.0\nposition = 3000.0\n[coupling]\ndamping = {{ min = 1e-3, max = {} }}\n"
    axes = '"transparency.weights.coupling" = [0.1, 1.0, 10.0]\n"device.damping" = [1.0, 2.0]\n'
    for most, times in ((5.0, 2), (1e4, 6)):
        folder = tmp_path / str(times)
        path = write_study(folder, axes, narrow.format(most))
        table = swept(path, folder, executor="serial")
        assert len(solved) == times
        solved.clear()
        assert list(table.status) == (["infeasible"] * 6 if times == 2 else ["certified"] * 6)
    for values in ((0.1, 1.0), (10.0, 2.0)):
        problem, _ = read_study(tmp_path / "2/study.toml").at(values)
        own = {name: number for name, number in solve_point(problem).items() if name != "seconds"}
        rows = [json.loads(row) for row in rows_in(tmp_path / "2/rows.jsonl").values()]
        (row,) = (row for row in rows if tuple(row["point"].values()) == values)
        assert own == {name: row[name] for name in own}


def test_two_jobs_make_the_same_bits_as_one_in_any_order(tmp_path, reference):
    path, rows, _ = reference
    assert len(rows) == 12 and all('"certified"' in row for row in rows.values())
    other = path.with_name("reordered.toml")
    other.write_text(path.read_text().replace("[0.0, 3e-4, 1e-3]", "[1e-3, 0.0, 3e-4]"))
    swept(other, tmp_path, jobs=2)
    assert rows_in(tmp_path / "rows.jsonl") == rows


@contextmanager
def dask_cluster(count):
    """Start a scheduler and workers, each a process of its own on loopback; yield its address and the workers."""
    quiet = {**os.environ, "DASK_LOGGING__DISTRIBUTED": "info", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    processes = [subprocess.Popen([*command, "--no-dashboard"], stderr=subprocess.PIPE, text=True, env=quiet)]
    try:
        address = next(found[1] for line in processes[0].stderr if (found := re.search(r"at: +(tcp://\S+)", line)))
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
        for _ in range(count):
            processes.append(subprocess.Popen([*worker, "--no-dashboard"], stderr=subprocess.DEVNULL, env=quiet))
        from distributed import Client

        with Client(address) as client:
            client.wait_for_workers(count, timeout=60)
        yield address, processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()
        processes[0].stderr.close()


@pytest.mark.slow
def test_dask_makes_the_same_bits_though_a_worker_is_killed(tmp_path, reference):
    path, rows, table = reference
    with dask_cluster(2) as (address, workers):
        running = started("sweep", path, "--executor", f"dask:{address}", cwd=tmp_path)
        file = tmp_path / "results" / path.stem / "rows.jsonl"
        wait_for_rows(running, file, 3)
        workers[0].kill()
        _, err = running.communicate(timeout=120)
    assert running.returncode == ExitCode.OK and without_progress(err) == ""
    assert rows_in(file) == rows
    assert (file.parent / "table.csv").read_text() == table


@pytest.mark.slow
def test_a_local_dask_cluster(tmp_path):
    table = swept(write_study(tmp_path, FEW, FIXED), tmp_path, jobs=1, executor="dask")
    assert table.status.count("invalid") == 3 and len(table.status) == 6


def wait_for_rows(process, file, count):
    wait_until(lambda: process.poll() is not None or (file.exists() and file.read_bytes().count(b"\n") > count))


def family(process):
    """Return the processes that a running one has started, and theirs."""
    return psutil.Process(process.pid).children(recursive=True)


def has_ended(child):
    try:
        return child.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def kill_and_resume(folder, path, stops, signals=(signal.SIGKILL,)):
    """Run a study, ended at each of some numbers of rows, then to its end; return what the file then has."""
    file = folder / "results" / path.stem / "rows.jsonl"
    for number, stop in enumerate(stops):
        process = started("sweep", path, "--jobs", "2", cwd=folder)
        wait_for_rows(process, file, stop)
        before, children = file.read_bytes().rpartition(b"\n")[0], family(process)
        process.send_signal(signals[number % len(signals)])
        _, err = process.communicate(timeout=60)
        assert process.returncode in (0, 130, -signal.SIGKILL)
        if process.returncode == ExitCode.INTERRUPTED:
            assert without_progress(err).strip() == "interrupted; running it again resumes"
        wait_until(lambda: all(map(has_ended, children)))  # noqa: B023
        assert file.read_bytes().startswith(before)
    process = started("sweep", path, "--jobs", "2", cwd=folder)
    _, err = process.communicate(timeout=300)
    assert process.returncode == ExitCode.OK and without_progress(err) == ""
    return rows_in(file)


def test_an_empty_file_of_rows_is_begun_and_a_torn_line_is_told(tmp_path):
    path = write_study(tmp_path, FEW, FIXED)
    for options in ([], ["--restart"]):
        rows = tmp_path / "results/study/rows.jsonl"
        rows.parent.mkdir(parents=True, exist_ok=True)
        rows.write_text("")
        done = run("sweep", path, "--executor", "serial", *options, cwd=tmp_path)
        assert done.stderr == "" and len(rows.read_text().splitlines()) == 7
    rows.write_text(rows.read_text()[:-20])
    said = run("sweep", path, "--executor", "serial", cwd=tmp_path).stderr
    assert "rows.jsonl: 1 torn lines dropped [rows-torn]" in said and len(rows.read_text().splitlines()) == 7


@pytest.mark.slow
def test_killed_again_and_again_nothing_is_lost_repeated_or_torn(tmp_path):
    path = write_study(tmp_path, MANY.format(12), FIXED)
    plain = tmp_path / "plain"
    plain.mkdir()
    table = swept(path, plain, jobs=2)
    rows = kill_and_resume(tmp_path, path, [0, 3, 40], (signal.SIGKILL, signal.SIGINT, signal.SIGTERM))
    assert rows == rows_in(plain / "rows.jsonl") and len(rows) == 144
    assert (tmp_path / "results/study/table.csv").read_text() == csv_text(table)


@pytest.mark.slow
def test_a_worker_killed_from_outside_costs_no_row(tmp_path):
    path = write_study(tmp_path, MANY.format(12), FIXED)
    process = started("sweep", path, "--jobs", "2", cwd=tmp_path)
    wait_for_rows(process, tmp_path / "results/study/rows.jsonl", 5)
    workers = [child for child in family(process) if any("spawn_main" in word for word in child.cmdline())]
    workers[-1].kill()
    _, err = process.communicate(timeout=120)
    assert process.returncode == ExitCode.OK and without_progress(err) == ""
    rows = rows_in(tmp_path / "results/study/rows.jsonl")
    assert len(rows) == 144 and not any('"failed"' in row for row in rows.values())


def dies_at_two(problem, time_limit):
    if problem.device.damping == 2.0:
        os._exit(9)
    return solve_point(problem, time_limit)


def breaks_at_two(problem, time_limit):
    return solve_point(None if problem.device.damping == 2.0 else problem, time_limit)


@pytest.mark.slow
@pytest.mark.parametrize(("work", "reason"), [(dies_at_two, "died"), (breaks_at_two, "internal error: AttributeError")])
def test_a_point_that_breaks_its_worker_is_a_failed_row_until_it_is_mended(tmp_path, monkeypatch, work, reason):
    path = write_study(tmp_path, '"device.damping" = [1.0, 1.5, 2.0, 3.0, 4.0]', FIXED)
    monkeypatch.setattr(sweeping, "solve_point", work)
    table = swept(path, tmp_path, jobs=2)
    assert [status == "failed" for status in table.status] == [False, False, True, False, False]
    assert reason in table.reason[2] and isnan(table.numbers["error"][2])
    monkeypatch.undo()
    mended = swept(path, tmp_path, jobs=2)
    assert "failed" not in mended.status
    lines = (tmp_path / "rows.jsonl").read_text().splitlines()
    assert len(lines) == 1 + 5 + 1  # header, points, the failed one again


def test_the_key_is_of_every_number_and_of_no_name():
    key = key_of(parse_problem(FREE, "x", "one"))
    other = 'name = "other"\n' + FREE + '[[experiment]]\nname = "e"\n'
    assert key_of(parse_problem(other, "y", "two")) == key
    for old, new in (("0.4", "0.41"), ("2.0", "2.1"), ("1e-3", "1.1e-3"), ("[0.5", "[0.6"), ("100.0", "99.0")):
        assert key_of(parse_problem(FREE.replace(old, new), "x", "one")) != key
    assert key_of(parse_problem(FREE + "safety_factor = 1.06\n", "x", "one")) != key


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished")
    path = write_study(folder, '"device.damping" = [1.0, 2.0, 3.0]', FIXED)
    swept(path, folder)
    return read_study(path), (folder / "rows.jsonl").read_bytes()


@given(st.data())
def test_a_file_cut_anywhere_keeps_its_whole_rows_and_may_be_concatenated(tmp_path_factory, finished, data):
    """Torn or not; what is torn is told, and its point is solved again."""
    plan, whole = finished
    header = whole.index(b"\n") + 1
    cut = data.draw(st.integers(header, len(whole)))
    path = tmp_path_factory.mktemp("merged") / "rows.jsonl"
    path.write_bytes(whole[:cut])
    with open_rows(path, plan, restart=False) as rows:
        assert len(rows.known) == whole[:cut].count(b"\n") - 1
    assert path.read_bytes() == whole[: whole.rindex(b"\n", 0, cut) + 1]
    path.write_bytes(whole[:cut] + whole)
    with open_rows(path, plan, restart=False) as rows:
        assert len(rows.known) == 3
        assert rows.dropped == (whole[cut - 1 : cut] != b"\n")
        assert {row["point"]["device.damping"] for row in rows.known.values()} == {1.0, 2.0, 3.0}


def test_restart_begins_anew(tmp_path):
    path = write_study(tmp_path, '"device.damping" = [1.0, 2.0]', FIXED)
    swept(path, tmp_path)
    first = (tmp_path / "rows.jsonl").read_bytes()
    swept(path, tmp_path)
    assert (tmp_path / "rows.jsonl").read_bytes() == first
    path.write_text(path.read_text().replace("[1.0, 2.0]", "[2.0]"))
    assert len(swept(path, tmp_path, restart=True).status) == 1
    assert len(rows_in(tmp_path / "rows.jsonl")) == 1


def test_more_points_of_a_study_go_on_with_its_rows(tmp_path):
    path = write_study(tmp_path, '"device.damping" = [1.0, 2.0]', FIXED)
    swept(path, tmp_path)
    first = (tmp_path / "rows.jsonl").read_bytes()
    path.write_text(path.read_text().replace("[1.0, 2.0]", "[2.0, 3.0, 3.0]"))
    table = swept(path, tmp_path)
    assert table.axes["device.damping"].tolist() == [2.0, 3.0, 3.0]
    assert (tmp_path / "rows.jsonl").read_bytes().startswith(first)
    assert len(rows_in(tmp_path / "rows.jsonl")) == 3


REFUSED = {
    "another study": (lambda text: text.replace("device.damping", "device.mass"), [], "holds rows of another study"),
    "another, restarted": (lambda text: text.replace("device.damping", "device.mass"), ["--restart"], "another study"),
    "a million": (
        lambda text: text.replace("[1.0, 2.0]", "{ log = [1, 2], n = 1000000 }"), [], "1,000,000 points",
    ),
    "unreachable": (lambda text: text, ["--restart", "--executor", "dask:tcp://127.0.0.1:9"], "cannot be reached"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused_touches_nothing(tmp_path, finished, case):
    change, arguments, message = REFUSED[case]
    path = write_study(tmp_path, '"device.damping" = [1.0, 2.0]', FIXED)
    folder = tmp_path / "results" / "study"
    folder.mkdir(parents=True)
    (folder / "rows.jsonl").write_bytes(finished[1])
    (folder / "table.csv").write_text("as it was")
    path.write_text(change(path.read_text()))
    done = run("sweep", path, *arguments, cwd=tmp_path)
    assert done.returncode == ExitCode.BAD_INPUT and done.stdout == ""
    assert message in done.stderr and "Traceback" not in done.stderr
    assert (folder / "rows.jsonl").read_bytes() == finished[1]
    assert sorted(file.name for file in folder.iterdir()) == ["rows.jsonl", "table.csv"]


@pytest.mark.parametrize(
    "content",
    [b"a,b\n1,2\n", b'{"schema": "vctune/design/1"}\n', b'{"schema": "vctune/rows/2", "study": "x"}\n', b"\xff\xfe\n"],
)
def test_a_file_that_is_no_file_of_rows_is_left_alone(tmp_path, finished, content):
    path = tmp_path / "rows.jsonl"
    path.write_bytes(content)
    for restart in (False, True):
        with pytest.raises(InputError, match="not a file of rows"), open_rows(path, finished[0], restart=restart):
            pass
    assert path.read_bytes() == content


def test_one_run_at_a_time(tmp_path, finished):
    path = tmp_path / "rows.jsonl"
    with open_rows(path, finished[0], restart=False):
        for restart in (False, True):
            with pytest.raises(InputError, match="by another run"), open_rows(path, finished[0], restart=restart):
                pass


@pytest.mark.slow
def test_a_full_disk_stops_the_run_and_keeps_the_rows(tmp_path):
    path = write_study(tmp_path, MANY.format(6), FIXED)
    done = on_a_full_disk(14000, "sweep", path, cwd=tmp_path)
    assert done.returncode == ExitCode.BAD_INPUT and "its rows are kept" in done.stderr
    whole = (tmp_path / "results/study/rows.jsonl").read_bytes().rpartition(b"\n")[0].splitlines()
    assert len(whole) > 10
    assert run("sweep", path, "--executor", "serial", cwd=tmp_path).returncode == ExitCode.OK
    assert len(rows_in(tmp_path / "results/study/rows.jsonl")) == 36


def test_workers_have_one_thread_whenever_they_start(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    with worker_pool("processes", 1) as pool:
        assert pool.executor.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
        pool.renew()
        assert pool.executor.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
    assert os.environ["OMP_NUM_THREADS"] == "7"
