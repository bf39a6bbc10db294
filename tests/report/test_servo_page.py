"""What a person sees of a servo: latency and contacts in the table, on the page and in messages; nothing of a loop."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from pages import made

from vctune import check, compare, explain
from vctune.analysis.contact import drag_at_rest, greatest_drag, stiffest_contact
from vctune.analysis.in_hands import least_ratios_in_hands
from vctune.design.solve import solve
from vctune.design.verdict.design_record import record_of
from vctune.design.verdict.judge import judge
from vctune.design.verdict.parameter_changes import parameter_changes
from vctune.design.verdict.prices import with_prices
from vctune.document.reading import ProblemFile, parse_problem
from vctune.document.text import toml
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import LINEAR
from vctune.model.sampled.servo_in_hand import demand_of
from vctune.model.servo import latency
from vctune.report.page.summary import summary
from vctune.report.page.tables import asked, assumptions, feel_lines

ARM = """[device]
sample_time = 0.002
servo = { delay = 0.032, bandwidth_hz = 20.0, order = 2 }
[operator]
mass = { min = 0.0, max = 2.0 }
damping = { min = 0.0, max = 30.0 }
stiffness = { min = 0.0, max = 1000.0 }
"""
SENSED = ARM.replace("[operator]", "force_sensor = { bandwidth_hz = 60.0, delay = 3e-3 }\n[operator]").replace(
    "order = 2", 'order = 1, command = "position"'
)
HEAVY = "[coupling]\ndamping = 500.0\nmass = 2.7\ndrag = {}\n"
OF_A_LOOP = r"K_v|K_p|\|S\||Nyquist's|velocity loop|without a loop|bare device|G_hh|idle|gain margin|gains\."
NO_GAINS = Gains(0.0, 0.0)


def posed(text):
    return parse_problem(text, "arm.toml", "arm")


@pytest.fixture(scope="module")
def arm():
    """The best design for the arm: its record and problem."""
    problem = posed(SENSED)
    return record_of(ProblemFile(problem, SENSED), with_prices(solve(problem))), problem


def given(text):
    problem = posed(text)
    return record_of(ProblemFile(problem, text), solve(problem)), problem


def test_the_latency_is_split_into_its_parts(arm):
    record, problem = arm
    parts = {part.part: part.latency_s for part in record.contact.parts}
    assert parts == pytest.approx({
        "hold": 0.001, "interpolation": 0.001, "delay": 0.032, "lag": 1 / (2 * np.pi * 20.0),
        "force sensor": 0.003 + 1 / (2 * np.pi * 60.0),
    })  # fmt: skip
    assert (
        record.contact.latency_s == pytest.approx(sum(parts.values())) == float(latency(problem.device, FLOATS).total)
    )
    asked_for = 1.05 * 1000.0 * record.contact.latency_s
    assert record.contact.rest_drag == pytest.approx(asked_for, rel=1e-9)
    assert sum(part.drag for part in record.contact.parts) == pytest.approx(asked_for)
    assert record.coupling.drag >= asked_for * (1 - 1e-12)
    less, lighter = record.contact.example()
    shorter = replace(problem, device=problem.device.with_numbers({"servo.delay": 0.032 - less}))
    assert lighter == pytest.approx(1.05 * drag_at_rest([shorter.device], problem.hands), rel=1e-9)


def test_damping_in_every_hand_lightens_the_drag():
    device = posed(ARM).device
    hands = Hands(Hand(0.0, 10.0, 0.0), Hand(2.0, 30.0, 1000.0))
    assert drag_at_rest([device], hands) == pytest.approx(1000.0 * 0.044253953958 - 10.0, rel=1e-6)
    assert drag_at_rest([device], Hands(Hand(0.0, 50.0, 0.0), Hand(2.0, 60.0, 1000.0))) == 0.0
    damped = given(ARM.replace("damping = { min = 0.0", "damping = { min = 10.0") + HEAVY.format(120.0))[0].contact
    assert damped.rest_drag == pytest.approx(1.05 * (1000.0 * damped.latency_s - 10.0), rel=1e-9)
    assert "1.05 K L less the damping of every hand" in {row.unit.partition(": ")[2] for row in damped.rows(LINEAR)}


def test_the_filter_of_the_samples_is_late_too_and_the_own_spring_asks_for_drag():
    filtered = ARM.replace("[operator]", "force_sensor = { filter_coefficient = 0.2 }\n[operator]")
    sprung = filtered.replace("order = 2", "order = 2, stiffness = 200.0") + HEAVY.format(90.0)
    contact = given(sprung)[0].contact
    assert {part.part: part.latency_s for part in contact.parts}["filter"] == pytest.approx(0.002 * 0.8 / 0.2)
    moved = contact.latency_s - 0.008
    assert contact.rest_drag == pytest.approx(1.05 * (1000.0 * contact.latency_s + 200.0 * moved), rel=1e-9)
    assert contact.rule == "1.05 K L and the drag of the own spring"


def test_an_own_spring_also_needs_less_drag_with_less_latency():
    """The example shortens the servo, whose latency counts for the contacts and for the own spring."""
    filtered = ARM.replace("[operator]", "force_sensor = { filter_coefficient = 0.2 }\n[operator]")
    record, problem = given(filtered.replace("order = 2", "order = 2, stiffness = 200.0") + HEAVY.format(90.0))
    less, lighter = record.contact.example()
    shorter = problem.device.with_numbers({"servo.delay": 0.032 - less})
    assert lighter == pytest.approx(1.05 * drag_at_rest([shorter], problem.hands), rel=1e-9)
    (row,) = (row for row in record.contact.rows(LINEAR) if row.label == "with less latency")
    assert row.unit == f"N s/m if {1e3 * less:g} ms are saved outside the force sensor"


def test_a_coupling_that_bears_no_contact_is_compared_with_the_softest_hands():
    """The least stiffness of the box may be above 0."""
    stiff = ARM.replace("stiffness = { min = 0.0", "stiffness = { min = 900.0")
    for text in (ARM + HEAVY.format(40.0), stiff + HEAVY.format(30.0)):
        contact = given(text)[0].contact
        assert contact.stiffest_contact is None
        (row,) = (row for row in contact.rows(LINEAR) if row.label == "stiffest contact")
        assert row.unit == "even the softest hands require more than this coupling offers"


@pytest.mark.parametrize(
    ("device", "said"),
    [
        ("", "shorten device.servo.delay"),
        ("force_sensor = { filter_coefficient = 1e-2 }\n", "raise device.force_sensor.filter_coefficient"),
        ("force_sensor = { delay = 0.1 }\n", "state a quicker device.force_sensor"),
    ],
)
def test_too_little_drag_names_the_longest_part_of_the_latency(device, said):
    text = ARM.replace("[operator]", f"{device}[operator]") + "[coupling]\ndrag = 0.0\n"
    reason = solve(posed(text)).reason
    assert reason.endswith(said) and "inf" not in reason


def test_what_drag_alone_needs_is_the_greatest_of_every_hand_and_frequency():
    device, hands = posed(SENSED).device, posed(SENSED).hands
    most = greatest_drag([device], hands)
    theta = np.linspace(0.0, np.pi, 20001)
    sampled = demand_of(device, hands).at(theta).max()
    assert sampled <= most.drag * (1 + 1e-12) and most.drag == pytest.approx(sampled, rel=1e-5)
    alone = Coupling(1e15, 1e-15, most.drag)
    assert least_ratios_in_hands(device, hands, NO_GAINS, alone)[0].ratio == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("drag", [90.0, 140.0, 200.0])
def test_the_stiffest_contact_is_where_the_ratio_is_the_factor(drag):
    problem, coupling = posed(ARM), Coupling(500.0, 2.7, drag)
    K = stiffest_contact([problem.device], problem.hands, coupling, 1.05)
    for share, passes in ((1 - 1e-3, True), (1 + 1e-3, False)):
        hands = replace(problem.hands, high=replace(problem.hands.high, stiffness=share * K))
        least = least_ratios_in_hands(problem.device, hands, NO_GAINS, coupling)[0].ratio
        assert (least > 1.05) == passes


def test_the_stiffest_contact_is_proved_and_a_little_more_is_refuted():
    record, problem = given(ARM + HEAVY.format(90.0))
    found = record.contact
    assert record.status == "certified" and found.stiffest_contact > 1000 and found.stiffest_contact_verdict == "proved"

    def verdict(stiffness):
        high = replace(problem.hands.high, stiffness=stiffness)
        harder = replace(problem, hands=replace(problem.hands, high=high))
        return judge(harder, *record.design).certificate.verdict.value

    assert verdict(found.stiffest_contact) == "proved" and verdict(1.003 * found.stiffest_contact) == "refuted"


def test_what_is_too_light_bears_softer_contacts_or_none():
    """Of a light tool the contact decides, of a heavy one the tool."""
    device, hands = posed(ARM).device, posed(ARM).hands
    light = replace(hands, high=Hand(0.2, 10.0, 1000.0))
    coupling = Coupling(500.0, 2.7, 40.0)
    bears = stiffest_contact([device], light, coupling, 1.05)
    assert bears == pytest.approx(40.0 / 1.05 / float(latency(device, FLOATS).total), rel=1e-6)
    assert stiffest_contact([device], hands, coupling, 1.05) < 0
    firm = replace(light, low=Hand(0.0, 0.0, 500.0))
    assert stiffest_contact([device], firm, coupling, 1.05) == pytest.approx(bears, rel=1e-6)
    record, _ = given(ARM.replace("max = 2.0", "max = 0.2").replace("30.0", "10.0") + HEAVY.format(40.0))
    assert record.status == "violated" and 0.998 * bears < record.contact.stiffest_contact < bears
    assert record.contact.stiffest_contact_verdict == "proved"
    record, _ = given(ARM + HEAVY.format(40.0))
    assert record.contact.stiffest_contact is None
    assert [row.value for row in record.groups()["contact"]][-1] == "none"


def test_the_slowest_servo_of_a_box_counts():
    text = ARM + '[uncertainty]\n"servo.delay" = 0.1\n' + HEAVY.format(120.0)
    record, _ = given(text)
    sure, _ = given(ARM + HEAVY.format(120.0))
    assert record.contact.latency_s - sure.contact.latency_s == pytest.approx(0.0032)
    assert record.contact.stiffest_contact < sure.contact.stiffest_contact
    assert not re.search("mass|kg", record.uncertainty.min_ratio_device.in_words(record.units))


def test_the_table_names_no_loop_and_explains_its_rows(arm):
    record, _ = arm
    rows = [(group, row) for group, rows in record.groups().items() for row in rows]
    assert not any(re.search(OF_A_LOOP, f"{group} {row.label} {row.unit}") for group, row in rows)
    labels = {row.label for group, row in rows if group == "contact"}
    assert labels == {
        "latency L", "least drag at rest", "with less latency", "least drag without b_c", "stiffest contact",
    }  # fmt: skip
    assert all(explain(label).entries for label in labels)
    assert not any("admittance" in line for line in record.left_out)


def test_the_page_says_what_there_is(arm, tmp_path):
    record, _ = arm
    page = made(record.to_json(), tmp_path).read_text()
    text = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(OF_A_LOOP, re.sub(r"<pre>.*?</pre>", "", text, flags=re.DOTALL))
    assert {path.stem for path in tmp_path.glob("*.svg")} == {"loop", "hands", "impedance", "transparency", "latency"}
    for said in ("Drag is stiffness times latency", "device.<wbr>servo.<wbr>delay", "vendor's loop", "cmd</tspan>"):
        assert said in text, said
    assert not re.search(r"\bnan\b", text)


def test_the_tables_of_the_page_have_the_servo_in_them(arm):
    record, problem = arm
    device = {line.label for line in asked(problem)["Device"]}
    assert {"servo: delay", "servo: bandwidth", "servo: order", "command"} <= device
    assert not device & {"mass m", "damping b", "delay", "velocity", "hold"}
    assert not any("|S|" in line.label for line in asked(problem)["Constraints"])
    assert any("does not yield" in line for line in assumptions(problem))
    assert not any(line.bare or "wall" in line.label for line in feel_lines(problem, *record.design))
    assert "contacts up to 1000 N/m need a drag of at least" in summary(record, problem).measure


def test_prices_are_those_of_solving_again(arm):
    record, problem = arm
    prices = {price.key: price for price in record.prices}
    assert prices.keys() == {
        "device.sample_time", "device.servo.delay", "device.servo.bandwidth_hz", "device.force_sensor.bandwidth_hz",
        "device.force_sensor.delay", "operator.mass.max", "operator.damping.max", "operator.stiffness.max",
    }  # fmt: skip
    faster = problem.device.with_numbers({"servo.delay": prices["device.servo.delay"].new})
    softer = replace(problem.hands.high, stiffness=prices["operator.stiffness.max"].new)
    for key, other in (
        ("device.servo.delay", replace(problem, device=faster)),
        ("operator.stiffness.max", replace(problem, hands=replace(problem.hands, high=softer))),
    ):
        worth = solve(other).judgement.error / record.transparency.error - 1
        assert prices[key].change == pytest.approx(worth, abs=2e-4) and worth < -1e-3, key


def test_a_jump_has_no_price():
    """Where a delay passes a whole number of samples the error jumps: what that is worth is no slope."""
    text = ARM.replace("order = 2", "order = 1").replace("[operator]", "force_sensor = { delay = 2e-3 }\n[operator]")
    prices = with_prices(solve(posed(text))).prices
    assert all(-0.05 < price.change <= 0 for price in prices)


def test_repairs_name_the_keys_of_a_servo():
    text = SENSED + "[coupling]\ndrag = { min = 0.0, max = 30.0 }\n"
    changes = {change.key: change for change in parameter_changes(toml.parse(text, "x"), posed(text))}
    assert {"device.servo.delay", "device.servo.bandwidth_hz", "device.force_sensor.delay"} <= changes.keys()
    assert not changes.keys() & {"device.delay", "device.damping", "device.mass", "stability.max_sensitivity"}
    assert changes["device.servo.delay"].old == 0.032 and changes["device.servo.delay"].limit == 0
    assert changes["device.servo.bandwidth_hz"].meaning == "a faster servo"


def test_a_mass_that_it_has_not_changes_no_change():
    """Natural sizes are those of Z_0, not of the mass on which nothing of a servo depends."""
    text = ARM + HEAVY.format(90.0)
    document, problem = toml.parse(text, "x"), posed(text)
    heavier = replace(problem, device=replace(problem.device, mass=7.0))
    assert parameter_changes(document, problem) == parameter_changes(document, heavier)


def test_why_there_is_no_design_is_said_of_the_drag():
    problem = posed(ARM + "[coupling]\ndrag = { min = 0.0, max = 30.0 }\n")
    reason = solve(problem).reason
    assert not re.search(OF_A_LOOP, reason)
    assert "the drag is" in reason and "44.25 ms" in reason and "device.servo.delay" in reason


def test_a_check_and_a_comparison_speak_of_no_loop():
    text = ARM + HEAVY.format(90.0)
    passed = check(posed(text))
    assert passed.result == "passed" and not re.search(OF_A_LOOP, passed.message)
    found = compare(given(text)[0].to_json(), given(text.replace("90.0", "95.0"))[0].to_json())
    assert not any(re.search(OF_A_LOOP, f"{value.label} {value.key}") for value in found.design)
    assert "contact.stiffest_contact" in {value.key for value in found.design}


def test_a_servo_of_a_library_is_solved_as_that_of_its_file():
    """What states it has nothing in it that a servo has not."""
    problem = posed(ARM + HEAVY.format(90.0))
    assert check(problem).result == "passed"
