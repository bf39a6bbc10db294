"""Logs that cannot be used get an answer that names row, column and remedy; nothing is guessed silently."""

from __future__ import annotations

import gzip
import re
import zipfile

import numpy as np
import pytest
from command import run, strict
from conftest import mostly_slow
from identification_logs import driven, encoded
from jsonschema import Draft202012Validator

from vctune import identify
from vctune.api.json_schemas import SCHEMAS
from vctune.document.log import read_log, read_log_map, read_logs
from vctune.document.recording import Channel, Recording
from vctune.document.text.errors import ENDING, InputError
from vctune.identification.checks import remarks
from vctune.model.device import Device
from vctune.model.experiment import USUAL_MASS, Friction

T = 1e-3
DEVICE = Device(0.4, 2.0, T, 4e-4)


@pytest.fixture(scope="module")
def log():
    """Six seconds of a rigid device under a slow random force."""
    random = np.random.default_rng(5)
    n = 6000
    f = np.fft.rfftfreq(n, T)
    wave = np.fft.irfft(np.fft.rfft(random.normal(size=n)) * (f > 0.5) / (1 + (f / 4.0) ** 2), n)
    force = 3.0 * wave / wave.std()
    recorded = driven(DEVICE, Friction(0.3, 0.3, 0.005, 1e5, 200.0), force)
    return {
        "time_s": np.arange(n) * T,
        "position_m": encoded(recorded["position"], 1e-6),
        "command_N": recorded["motor"],
    }


@pytest.fixture(scope="module")
def plain(log, tmp_path_factory):
    """What the log says."""
    return identify(written(tmp_path_factory.mktemp("plain"), log)).record


def written(folder, columns, name="log.csv"):
    path = folder / name
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")
    return path


def refused(path, config=None):
    with pytest.raises(InputError) as caught:
        identify(path, config)
    return str(caught.value)


@pytest.mark.slow
def test_a_rotary_device_says_so_in_its_file(log, plain, tmp_path):
    """The numbers are those of the linear one, in kg m2; the file reads back, with its experiment."""
    turned = dict(zip(("time_s", "position_rad", "command_Nm"), log.values(), strict=True))
    (tmp_path / "log.toml").write_text("rotary = true\n")
    path = written(tmp_path, turned)
    found = identify(path, tmp_path / "log.toml")
    assert [each.value for each in found.record.numbers] == [each.value for each in plain.numbers]
    assert {each.key: each.unit for each in found.record.numbers}["mass"] == "kg m2"
    assert 'units = "rotary"' in found.text and not re.search(r"\bkg\b(?! m2)|N s/m", found.text)
    problem = found.file.problem
    assert problem.device.units == "rotary"
    share = problem.device.mass / USUAL_MASS
    assert problem.experiments[0].operator.stiffness == pytest.approx(1000.0 * share, rel=1e-2)


@pytest.mark.slow
def test_order_of_columns_packing_and_separator_do_not_matter(log, plain, tmp_path):
    turned = written(tmp_path, dict(reversed(log.items())), "turned.csv")
    turned.write_text(turned.read_text().replace(",", ";"))
    packed = tmp_path / "packed.csv.gz"
    packed.write_bytes(gzip.compress(turned.read_bytes()))
    assert [each.value for each in identify(packed).record.numbers] == [each.value for each in plain.numbers]


FAULTS = {
    "constant column": (lambda c: c | {"command_N": 0 * c["time_s"] + 2.0}, ["command_N", "is 2 in every row"]),
    "millimetres called metres": (lambda c: c | {"position_m": 1e3 * c["position_m"]}, ["position_m", "mm"]),
    "millinewtons called newtons": (lambda c: c | {"command_N": 1e6 * c["command_N"]}, ["command_N", "reaches"]),
    "milliseconds called seconds": (lambda c: c | {"time_s": 1e3 * c["time_s"]}, ["time_s", 'unit = "ms"']),
    "swapped columns": (
        lambda c: {"time_s": c["time_s"], "position_m": c["command_N"], "command_N": c["position_m"]},
        ["swapped"],
    ),
    "not a number": (lambda c: c | {"position_m": _with(c["position_m"], 77, np.nan)}, [":79: position_m: nan"]),
    "rows without numbers": (
        lambda c: c | {key: np.where(c["time_s"] > 2.5, np.nan, c[key]) for key in ("position_m", "command_N")},
        ["position_m: nan is no finite number", "more rows are like it"],
    ),
    "two logs joined": (
        lambda c: c | {"position_m": c["position_m"] + 0.3 * (np.arange(c["time_s"].size) >= 2000)},
        ["position_m: jumps by 0.", "in line 2002,", "two logs joined"],
    ),
    "time that starts again": (lambda c: c | {"time_s": c["time_s"] % 0.15}, [":152: time_s: runs backwards"]),
    "counts": (lambda c: c | {"position_m": np.round(c["position_m"] * 1e6)}, ["position_m", "counts"]),
    "gaps": (
        lambda c: {key: values.reshape(-1, 60)[:, :50].ravel() for key, values in c.items()},
        [":52: time_s", "10 samples"],
    ),
    "jitter": (lambda c: c | {"time_s": c["time_s"] + 4e-4 * np.sin(np.arange(6000.0))}, ["time_s", "jitters by"]),
    "another sign": (
        lambda c: {"time_s": c["time_s"], "position_rad": c["position_m"], "command_Nm": -c["command_N"]},
        ["the inertia comes out as -", " kg m2: command_Nm pushes", "scale = -1"],
    ),
    "decimated": (lambda c: c | {"position_m": np.repeat(c["position_m"][::4], 4)}, ["position_m", "every 4th row"]),
    "rounded": (lambda c: c | {"command_N": 3 * np.round(c["command_N"] / 3)}, ["command_N", "too few levels"]),
    "saturated": (lambda c: c | {"command_N": np.clip(c["command_N"], -1.0, 1.0)}, ["command_N", "at its limit"]),
    "position early": (
        lambda c: (
            {key: values[:-40] if key == "command_N" else values[40:] for key, values in c.items()}
            | {"time_s": c["time_s"][40:]}
        ),
        ["ahead of the force"],
    ),
}


def _with(values, at, value):
    values = values.copy()
    values[at] = value
    return values


@pytest.mark.parametrize("fault", mostly_slow(FAULTS, FAULTS.keys() - {"another sign", "position early"}))
def test_a_fault_is_named(log, tmp_path, fault):
    spoil, named = FAULTS[fault]
    (tmp_path / "log.toml").write_text("rotary = true\n")
    columns = spoil(log)
    message = refused(written(tmp_path, columns), tmp_path / "log.toml" if "position_rad" in columns else None)
    assert all(part in message for part in named), message


FAR = {"a step back": [100], "a gap": [1500, 4100]}


@pytest.mark.parametrize("fault", FAR)
def test_the_longest_part_without_a_fault_of_its_time_is_used(log, tmp_path, fault):
    """And which part it is, is said; it alone has the same numbers."""
    time = log["time_s"].copy()
    for row in FAR[fault]:
        time[row:] += 0.5 if fault == "a gap" else -0.04
    first, end = max(zip([0, *FAR[fault]], [*FAR[fault], time.size], strict=True), key=lambda ends: ends[1] - ends[0])
    found = identify(written(tmp_path, log | {"time_s": time})).record
    part = {key: values[first:end] for key, values in log.items()}
    alone = identify(written(tmp_path, part | {"time_s": time[first:end]}, "alone.csv")).record
    assert found.recordings[0].samples == end - first
    assert [each.value for each in found.numbers] == pytest.approx([each.value for each in alone.numbers], rel=1e-3)
    (said,) = (each for each in found.remarks if "[remark-cut]" in each)
    assert f"lines {first + 2} to {end + 1}, {end - first} of {time.size} rows" in said


def test_columns_that_no_role_names_may_hold_anything(log, plain, tmp_path):
    path = written(tmp_path, log)
    header, *rows = path.read_text().splitlines()
    notes = ['"{""a"": 1, ""b"": [2]}"', "RUN", "", "nan", '"x,y"']
    path.write_text("\n".join([f"{header},note", *(f"{row},{notes[i % 5]}" for i, row in enumerate(rows))]))
    found = identify(path).record
    assert [each.value for each in found.numbers] == [each.value for each in plain.numbers]
    assert any("columns that were not used: note" in each for each in found.remarks)
    assert any("position_m as position, command_N as command" in each for each in found.remarks)


def test_a_quote_that_is_not_closed_takes_no_row_with_it(log, plain, tmp_path):
    path = written(tmp_path, log)
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"{header},note", *(f'{row},"open' for row in rows)]))
    assert [each.value for each in identify(path).record.numbers] == [each.value for each in plain.numbers]
    path.write_text("\n".join([f"{header},note", *(f"{row},{'x' * 200_000}" for row in rows[:20])]))
    assert "log.csv:2: is no row of a table" in refused(path)


def test_few_rows_last_a_second(log, tmp_path):
    message = refused(written(tmp_path, {key: values[:250] for key, values in log.items()}))
    assert "has 250 samples in 0." in message and "at least 500, or 1 s" in message


def test_rows_of_a_slower_loop_are_found_in_its_log(tmp_path, log):
    """Five rows of the log for each of the loop: these are those in which the command changes."""
    five = {key: np.repeat(values, 5) for key, values in log.items()}
    T = float(log["time_s"][1] - log["time_s"][0])
    five["time_s"] = np.arange(five["time_s"].size) * T / 5
    steps = np.arange(five["time_s"].size)
    five["position_m"] = np.interp(steps, steps[::5], log["position_m"])
    config = tmp_path / "log.toml"
    config.write_text(f"sample_time = {T!r}\n")
    finer, plain = (
        identify(written(tmp_path, five), config).record,
        identify(written(tmp_path, log, "plain.csv")).record,
    )
    assert finer.sample_time == T and any("[remark-finer]" in each for each in finer.remarks)
    assert [each.value for each in finer.numbers] == pytest.approx([each.value for each in plain.numbers], rel=2e-3)


def test_one_log_of_a_device_may_have_fewer_columns(log, tmp_path):
    """A column that the map names is missing in one of two logs; in both it is a fault."""
    config = tmp_path / "log.toml"
    config.write_text('[columns]\nhand = "pushed_N"\n[columns.command]\ncolumn = "u"\nscale = 1.0\n')
    one = {("u" if key == "command_N" else key): values for key, values in log.items()}
    both = [
        written(tmp_path, one | {"pushed_N": 1e-3 * np.sin(log["time_s"])}, "a.csv"),
        written(tmp_path, one, "b.csv"),
    ]
    roles = [set(each.channels) for each in read_logs(both, read_log_map(config))]
    assert roles == [{"time", "position", "command", "hand"}, {"time", "position", "command"}]
    with pytest.raises(InputError, match='has no column "pushed_N"'):
        read_logs(both[1:], read_log_map(config))


@pytest.mark.slow
def test_the_command_writes_a_device_that_solves(log, tmp_path):
    written(tmp_path, log)
    done = run("identify", "log.csv", "--out", "out", "--no-report", "--json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    page, folder = strict(done.stdout), tmp_path / "out" / "log"
    said = [*page["remarks"], *(each["limit"] for each in page["numbers"])]
    assert len(said) > 4 and all(ENDING.search(line) for line in said)
    assert sorted(path.name for path in folder.iterdir()) == ["device.toml", "identification.json"]
    assert page == strict((folder / "identification.json").read_text())
    assert list(Draft202012Validator(SCHEMAS["identification"]()).iter_errors(page)) == []
    solved = run("solve", folder / "device.toml", "--out", "solved", cwd=tmp_path)
    assert solved.returncode == 0, solved.stdout + solved.stderr


def test_a_workbook_is_named(tmp_path):
    path = tmp_path / "log.xlsx"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("[Content_Types].xml", "<Types/>")
        packed.writestr("xl/workbook.xml", "<workbook/>")
    assert refused(path) == f"{path}: is an Excel workbook and not text; save it as CSV [log-text]"


def test_a_column_that_the_map_names_is_in_no_other_role(log, tmp_path):
    """A header that ends in a unit of force is not the measured force too where it is named as the command."""
    config = tmp_path / "log.toml"
    config.write_text('[columns]\ncommand = "force_N"\n')
    force = dict(zip(("time_s", "position_m", "force_N"), log.values(), strict=True))
    recording = read_log(written(tmp_path, force), read_log_map(config))
    assert recording.values("force") is None and recording.values("command") is not None


@pytest.mark.parametrize("rounding", [1e-3, 0.01, 0.05])
@pytest.mark.parametrize("held", [1, 4])
def test_a_chirp_is_called_saturated_where_it_is_cut(rounding, held):
    """Rounding and a slower loop make flat peaks too, which are no saturation."""
    time = np.arange(8000) * 1e-3
    chirp = np.sin(2 * np.pi * (0.2 + 0.625 * time) * time)
    for most, told in ((1.0, 0), (0.9, 1)):
        command = np.repeat((np.round(np.clip(chirp, -most, most) / rounding) * rounding)[::held], held)
        channel = Channel("command_N", command, 1.0, None, None)
        recording = Recording("log.csv", "", 2, {"command": channel}, (), rotary=False)
        assert [each.code for each in remarks(recording)].count("remark-saturated") == told
