"""design.json names claims by identifiers; files from before, which have sentences alone, are read."""

from __future__ import annotations

import copy
import json
from dataclasses import replace

import jsonschema
import pytest
from command import run, strict
from conftest import DEVICE, ROOT, for_passive_hands

from vctune.document.reading import parse_problem
from vctune.document.records.certificate_json import WITHOUT_ID
from vctune.document.records.design_file import design_of, read_design
from vctune.document.records.json_schemas import SCHEMAS
from vctune.document.text.errors import InputError
from vctune.exit_codes import ExitCode
from vctune.model.display import ADMITTANCE
from vctune.proof.claims.registry import CLAIMS
from vctune.report.page.tables import claim_lines

OLD = sorted((ROOT / "results").glob("*/design.json"))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("claims")
    (folder / "wheel.toml").write_text(for_passive_hands(DEVICE))
    assert run("solve", "wheel.toml", cwd=folder).returncode == ExitCode.OK
    return folder / "results/wheel/design.json"


def without_ids(record):
    """Return the object of a design.json as versions before identifiers wrote it."""
    older = copy.deepcopy(record)
    for claim in older["certificate"]["claims"]:
        del claim["id"]
    return older


def table(record):
    read = design_of(record, "design")
    return claim_lines(read, parse_problem(read.problem.text, "wheel.toml", "wheel"))


def test_a_file_has_identifiers_and_sentences(written):
    claims = json.loads(written.read_text())["certificate"]["claims"]
    assert [(claim["id"], claim["claim"]) for claim in claims] == [
        (name, CLAIMS[name].said_of(ADMITTANCE)) for name in ("passive", "sensitivity", "stable_model", "stable")
    ]


def test_a_file_without_identifiers_gives_the_same_tables(written, tmp_path):
    record = json.loads(written.read_text())
    older = without_ids(record)
    assert table(older) == table(record)
    assert all(line.found for line in table(older) if line.label != CLAIMS["stable_model"].label)
    assert design_of(older, "design").to_json() == design_of(record, "design").to_json()
    (tmp_path / "design.json").write_text(json.dumps(older))
    compared = run("compare", "design.json", written, "--json", cwd=tmp_path)
    assert compared.returncode == ExitCode.OK and strict(compared.stdout)


def test_a_corrected_sentence_empties_no_report(written, monkeypatch):
    """Neither of an older file nor of one with identifiers: what is shown beside the sentence stays."""
    record = json.loads(written.read_text())
    before = table(record)
    for name, claim in CLAIMS.items():
        monkeypatch.setitem(CLAIMS, name, replace(claim, sentence=f"{name}, in other words"))
    assert table(record) == before == table(without_ids(record))


@pytest.mark.parametrize("path", OLD, ids=lambda path: path.parent.name)
def test_the_files_of_the_repository_are_read(path):
    known = read_design(path).certificate
    assert known is None or all(claim.id in CLAIMS for claim in known.claims)


def test_every_claim_of_the_time_is_known_by_its_sentence():
    assert set(WITHOUT_ID.values()) == {
        "passive",
        "sensitivity",
        "stable_model",
        "stable",
        "unmodelled",
        "any_hand",
        "hands",
    }


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"id": "bravery"}, "certificate.claims[0].id"),
        ({"id": None}, "certificate.claims[0].id"),
        ({"claim": "all is well"}, "'all is well' is no claim"),
        ({"claim": ["all", "is", "well"]}, "is no claim"),
    ],
)
def test_a_claim_that_nobody_knows_is_refused(written, change, said):
    record = json.loads(written.read_text())
    claim = (record if "id" in change else (record := without_ids(record)))["certificate"]["claims"][0]
    claim |= change
    with pytest.raises(InputError, match="damaged-document") as refused:
        design_of(record, "design.json")
    assert said in str(refused.value) and "solve the problem again" in str(refused.value)


def test_the_schema_takes_both(written):
    record, schema = json.loads(written.read_text()), SCHEMAS["design"]()
    for each in (record, without_ids(record)):
        jsonschema.validate(each, schema)
    record["certificate"]["claims"][0]["id"] = "bravery"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(record, schema)


@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_names_of_a_schema_are_words(kind):
    """Two classes of one name would be told apart by the paths of their modules."""
    names = SCHEMAS[kind]().get("$defs", {})
    assert all(name.isidentifier() and "__" not in name for name in names), names
